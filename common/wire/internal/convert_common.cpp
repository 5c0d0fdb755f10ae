// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/convert_common.h"

#include "common/base/utf8.h"
#include "common/image/still_mask.h"

namespace cairn::wire::internal {
namespace {

constexpr float kMostUpSigma = 1;                  ///< [rad]: more says nothing
constexpr size_t kMaxEncodedOverhead = 64 * 1024;  ///< of a JPEG over its raw size

}  // namespace

cairn_Pose encode_pose(const SE3& pose) {
  cairn_Pose encoded{};
  put_vector(pose.rotation().coeffs(), encoded.rotation);
  put_vector(pose.translation(), encoded.translation);
  return encoded;
}

cairn_Up encode_up(const std::optional<UpDirection>& up) {
  cairn_Up encoded{};
  if (!up) return encoded;
  put_vector(up->up, encoded.direction);
  encoded.sigma = static_cast<float>(up->sigma);
  return encoded;
}

std::optional<UpDirection> decode_up(const cairn_Up& up) {
  if (up.sigma == 0) return std::nullopt;
  return UpDirection{get_vector(up.direction).cast<double>().normalized(), up.sigma};
}

SE3 decode_pose(const cairn_Pose& pose) {
  const auto& q = pose.rotation;
  return {Eigen::Quaterniond(q[3], q[0], q[1], q[2]), Eigen::Vector3d(pose.translation)};
}

cairn_Image encode_image(const ImageMessage& image) {
  cairn_Image encoded{};
  encoded.encoding = static_cast<uint8_t>(image.encoding);
  encoded.width = image.width;
  encoded.height = image.height;
  borrow_sequence(image.bytes, &encoded.bytes);
  return encoded;
}

ImageMessage decode_image(const cairn_Image& image) {
  return {static_cast<ImageEncoding>(image.encoding), image.width, image.height,
          get_sequence<uint8_t>(image.bytes)};
}

void Check::text(const char* text, size_t max_bytes) {
  const std::string_view view(text == nullptr ? "" : text);
  require(view.size() <= max_bytes, "text too long");
  // They end in terminals and logs.
  require(!fault_of_text(view), "a text that is no UTF-8 or has characters that cannot be seen");
}

void require_name(const char* text, bool may_be_empty, const char* what, Check* check) {
  const std::string name = get_text(text);
  check->require((name.empty() && may_be_empty) || is_valid_name(name), what);
}

void Check::unit(const float (&vector)[3]) {
  const float norm = get_vector(vector).norm();
  require(std::abs(norm - 1) <= kUnitToleranceFloat, "direction not of unit length");
}

void Check::pose(const cairn_Pose& pose) {
  const double norm = Eigen::Map<const Eigen::Vector4d>(pose.rotation).norm();
  require(std::abs(norm - 1) <= kUnitTolerance, "quaternion not of unit length");
  for (const double value : pose.translation) length(value);
}

void Check::up(const cairn_Up& up) {
  if (up.sigma == 0) return;  // not known
  require(up.sigma > 0 && up.sigma <= kMostUpSigma, "sigma of up out of range");
  const float norm = Eigen::Map<const Eigen::Vector3f>(up.direction).norm();
  require(std::abs(norm - 1) <= kUnitToleranceFloat, "up is not of unit length");
}

void Check::image(const cairn_Image& image) {
  require(
      image.width >= 1 && image.width <= kMaxImageSide && image.height >= 1 && image.height <= kMaxImageSide,
      "image size out of range");
  const size_t raw = size_t{image.width} * image.height;
  switch (static_cast<ImageEncoding>(image.encoding)) {
    case ImageEncoding::kRaw:
      require(image.bytes._length == raw, "raw image of the wrong size");
      return;
    case ImageEncoding::kJpeg:
      require(image.bytes._length > 0 && image.bytes._length <= raw + kMaxEncodedOverhead,
              "encoded image of the wrong size");
      return;
  }
  require(false, "unknown image encoding");
}

void Check::pixel(const float (&pixel)[2]) {
  for (const float value : pixel) require(std::abs(value) <= kMaxPixel, "pixel out of range");
}

void Check::still_mask(const dds_sequence_octet& bits, const cairn_Image& image) {
  const size_t bytes = still_mask_bytes(static_cast<int>(image.width), static_cast<int>(image.height));
  require(bits._length == 0 || bits._length == bytes, "still mask of the wrong size");
}

void Check::command(const cairn_CommandNumber& number) {
  require(number.session != 0 && number.seq != 0, "command without session or number");
}

void Check::live_mask(uint64_t live, size_t slots) {
  require(slots <= kBlockSlots, "count out of range");
  require(slots >= kBlockSlots || (live >> slots) == 0, "live bit without slot");
}

}  // namespace cairn::wire::internal
