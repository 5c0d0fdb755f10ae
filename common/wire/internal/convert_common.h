// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <string_view>
#include <type_traits>

#include "common/base/enumerators.h"
#include "common/wire/internal/convert.h"

/// Parts that the conversions of several messages share.
namespace cairn::wire::internal {

constexpr uint32_t kSchemaVersion = cairn_SCHEMA_VERSION;

// ---- encoding

template <size_t N>
void put_id(const std::array<uint8_t, N>& bytes, uint8_t (&out)[N]) {
  std::copy(bytes.begin(), bytes.end(), out);
}

/// The generated structs have no const; a sample that is written is only read.
inline char* borrow(const std::string& text) {
  return const_cast<char*>(text.c_str());
}

template <typename Sequence, typename T>
void borrow_sequence(const std::vector<T>& values, Sequence* out) {
  out->_buffer = const_cast<T*>(values.data());
  out->_length = out->_maximum = static_cast<uint32_t>(values.size());
  out->_release = false;
}

/// A sequence of `count` elements in scratch, each filled by fill(index, element).
template <typename Sequence, typename Fill>
void fill_sequence(size_t count, Scratch* scratch, Sequence* out, Fill&& fill) {
  using Element = std::remove_pointer_t<decltype(out->_buffer)>;
  out->_buffer = scratch->array<Element>(count);
  out->_length = out->_maximum = static_cast<uint32_t>(count);
  out->_release = false;
  for (size_t i = 0; i < count; ++i) fill(i, out->_buffer[i]);
}

template <typename Derived, typename T, size_t N>
void put_vector(const Eigen::MatrixBase<Derived>& vector, T (&out)[N]) {
  for (size_t i = 0; i < N; ++i) out[i] = vector(static_cast<Eigen::Index>(i));
}

[[nodiscard]] cairn_Pose encode_pose(const SE3& pose);
[[nodiscard]] cairn_Up encode_up(const std::optional<UpDirection>& up);
[[nodiscard]] cairn_Image encode_image(const ImageMessage& image);

// ---- checks: each names what is unfit

[[nodiscard]] inline tl::unexpected<Error> unfit(const std::string& what) {
  return fail(ErrorCode::kDamaged, what);
}

/// Collects the first thing that is wrong with a sample.
class Check {
 public:
  /// Notes `what` unless `good`.
  void require(bool good, const char* what) {
    if (!good && what_ == nullptr) what_ = what;
  }
  [[nodiscard]] bool passed() const { return what_ == nullptr; }
  [[nodiscard]] const char* what() const { return what_; }

  void schema(uint32_t version) { require(version >= 1, "schema version"); }
  void text(const char* text, size_t max_bytes);
  void length(double value) {
    require(std::abs(value) <= kMaxLength, "length out of range");
  }  // false for NaN
  void distance(double value) { require(value >= 0 && value <= kMaxLength, "distance out of range"); }
  /// [ns] of any camera's clock, and such that differences of two never overflow: within 146 years.
  void time(int64_t nanoseconds) {
    require(nanoseconds > -kMaxTime && nanoseconds < kMaxTime, "time out of range");
  }
  void unit(const float (&vector)[3]);
  void pose(const cairn_Pose& pose);
  void up(const cairn_Up& up);
  void image(const cairn_Image& image);
  void pixel(const float (&pixel)[2]);
  /// Requires that the mask is empty, or of the size of the mask of such an image.
  void still_mask(const dds_sequence_octet& bits, const cairn_Image& image);
  /// Requires that a command has a session, and is numbered from 1 within it.
  void command(const cairn_CommandNumber& number);
  /// Requires at most kBlockSlots slots, and no live bits at or beyond `slots`.
  void live_mask(uint64_t live, size_t slots);
  template <typename Sequence>
  void count(const Sequence& sequence, size_t max) {
    require(sequence._length <= max && (sequence._length == 0 || sequence._buffer != nullptr),
            "count out of range");
  }

 private:
  const char* what_ = nullptr;
};

/// Checks the name of a client, rig, operator or wearer; the fault is named `what`.
void require_name(const char* text, bool may_be_empty, const char* what, Check* check);

/// `message` if the check passed, else the error.
template <typename Message>
[[nodiscard]] Result<Message> checked_message(const Check& check, Message&& message) {
  if (!check.passed()) return unfit(check.what());
  return std::forward<Message>(message);
}

// ---- decoding

template <typename Id>
[[nodiscard]] Id get_id(const uint8_t (&bytes)[16]) {
  Id id;
  std::copy(std::begin(bytes), std::end(bytes), id.bytes.begin());
  return id;
}

template <size_t N>
[[nodiscard]] auto get_vector(const float (&values)[N]) {
  return Eigen::Matrix<float, N, 1>(Eigen::Map<const Eigen::Matrix<float, N, 1>>(values));
}

[[nodiscard]] inline std::string get_text(const char* text) {
  return text == nullptr ? std::string() : std::string(text);
}
[[nodiscard]] SE3 decode_pose(const cairn_Pose& pose);
[[nodiscard]] std::optional<UpDirection> decode_up(const cairn_Up& up);
[[nodiscard]] ImageMessage decode_image(const cairn_Image& image);
[[nodiscard]] inline CommandId decode_command(const cairn_CommandNumber& number) {
  return {{number.session}, number.seq};
}

/// Encodes an answer to a client's commands (OfferVerdict, ClientReply), all but the decisions themselves.
template <typename Sample, typename Message>
[[nodiscard]] Sample encode_decided(const Message& message) {
  Sample sample{};
  put_id(message.client.bytes, sample.client_id);
  sample.schema_version = kSchemaVersion;
  sample.session = message.session.value;
  sample.last_decided = message.last_decided;
  sample.credit = message.credit;
  return sample;
}
/// Decodes such an answer, and refuses one with more decisions than the limits allow. The decisions
/// themselves are left to the caller.
template <typename Message, typename Sample>
[[nodiscard]] Result<Message> decode_decided(const Sample& sample, Check* check) {
  check->schema(sample.schema_version);
  check->count(sample.recent, kMaxOutcomes);
  if (!check->passed()) return unfit(check->what());
  auto message = decode_key<Message>(sample);
  message.session = {sample.session};
  message.last_decided = sample.last_decided;
  message.credit = sample.credit;
  message.recent.reserve(sample.recent._length);
  return message;
}

template <typename T, typename Sequence>
[[nodiscard]] std::vector<T> get_sequence(const Sequence& sequence) {
  return std::vector<T>(sequence._buffer, sequence._buffer + sequence._length);
}

template <typename Sequence>
[[nodiscard]] size_t sequence_bytes(const Sequence& sequence) {
  return sequence._length * sizeof(*sequence._buffer);
}
[[nodiscard]] inline size_t text_bytes(const char* text) {
  return text == nullptr ? 0 : std::string_view(text).size();
}

}  // namespace cairn::wire::internal
