// SPDX-License-Identifier: Apache-2.0
#include "client/capture/image_list_source.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <vector>

#include "common/io/image_file.h"
#include "common/io/image_header.h"
#include "common/io/text.h"

namespace cairn {
namespace {

struct ListedImage {
  Timestamp time;
  std::filesystem::path path;
};

/// Frames that are files of their own: the lists of TUM and EuRoC, and the image folder.
class ImageListSource final : public FrameSource {
 public:
  ImageListSource(std::string description, std::vector<ListedImage> images)
      : description_(std::move(description)), images_(std::move(images)) {}

  Result<std::optional<Frame>> next() override {
    if (next_ == images_.size()) return std::nullopt;
    const uint64_t index = next_++;
    auto image = read_gray_image(images_[index].path);
    if (!image) return tl::unexpected(image.error());
    return Frame{index, images_[index].time, std::make_shared<const GrayImage>(std::move(*image))};
  }
  std::optional<size_t> frame_count() const override { return images_.size(); }
  std::optional<PictureSize> picture_size() const override {
    for (const auto& image : images_) {
      const auto content = read_file(image.path);
      if (!content) continue;
      const auto header =
          read_image_header({reinterpret_cast<const uint8_t*>(content->data()), content->size()});
      if (header && header->width <= kMaxImageSide && header->height <= kMaxImageSide) {
        return PictureSize{static_cast<int>(header->width), static_cast<int>(header->height)};
      }
    }
    return std::nullopt;
  }
  std::string describe() const override {
    return description_ + ", " + std::to_string(images_.size()) + " images";
  }

 private:
  std::string description_;
  std::vector<ListedImage> images_;
  size_t next_ = 0;
};

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}

/// Cuts a run of digits, without leading zeros, off the front of `text`.
std::string_view take_digits(std::string_view& text) {
  const auto end = static_cast<size_t>(std::find_if_not(text.begin(), text.end(), is_digit) - text.begin());
  auto digits = text.substr(0, end);
  text.remove_prefix(end);
  digits.remove_prefix(std::min(digits.find_first_not_of('0'), digits.size()));
  return digits;
}

bool is_image_name(const std::filesystem::path& path) {
  auto extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  return extension == ".png" || extension == ".jpg" || extension == ".jpeg" || extension == ".pgm" ||
         extension == ".ppm";
}

Result<std::vector<std::filesystem::path>> images_in(const std::filesystem::path& directory) {
  std::error_code error;
  if (!std::filesystem::exists(directory, error)) {
    return fail(ErrorCode::kNotFound, directory.string() + ": no such directory");
  }
  std::vector<std::filesystem::path> paths;
  for (std::filesystem::directory_iterator at(directory, error), end; !error && at != end;
       at.increment(error)) {
    if (is_image_name(at->path())) paths.push_back(at->path());
  }
  if (error) return fail(ErrorCode::kIo, directory.string() + ": cannot be listed: " + error.message());
  if (paths.empty()) {
    return fail(ErrorCode::kNotFound, directory.string() + ": no png, jpg, jpeg, pgm or ppm file in it");
  }
  std::sort(paths.begin(), paths.end(), [](const auto& a, const auto& b) {
    return natural_less(a.filename().string(), b.filename().string());
  });
  return paths;
}

}  // namespace

bool natural_less(std::string_view a, std::string_view b) {
  const std::string_view whole_a = a;
  const std::string_view whole_b = b;
  while (!a.empty() && !b.empty()) {
    if (is_digit(a.front()) && is_digit(b.front())) {
      const auto digits_a = take_digits(a);
      const auto digits_b = take_digits(b);
      if (digits_a.size() != digits_b.size()) return digits_a.size() < digits_b.size();
      if (digits_a != digits_b) return digits_a < digits_b;
      continue;
    }
    if (a.front() != b.front()) return a.front() < b.front();
    a.remove_prefix(1);
    b.remove_prefix(1);
  }
  if (a.empty() != b.empty()) return a.empty();
  return whole_a < whole_b;  // equal but for leading zeros
}

Result<std::unique_ptr<FrameSource>> open_tum_source(const SourceUri& uri) {
  if (auto status = uri.check_options({}); !status) return tl::unexpected(status.error());
  const std::filesystem::path directory(uri.path);
  const auto list = directory / "rgb.txt";
  const auto content = read_text_file(list);
  if (!content) {
    auto error = content.error();
    if (error.code == ErrorCode::kNotFound) {
      error.message += "; tum: needs this list of rows `time file` (images:DIR takes a folder without one)";
    }
    return tl::unexpected(error);
  }
  std::vector<ListedImage> images;
  for (const auto& line : table_rows(*content)) {
    const size_t time_end = std::min(line.text.find_first_of(" \t"), line.text.size());
    const auto time = parse_timestamp(line.text.substr(0, time_end));
    const auto file = trim(line.text.substr(time_end));
    if (!time || file.empty()) {
      return fail(ErrorCode::kDamaged,
                  at_line(list, line.number, "not a row `time file` with the time in seconds"));
    }
    images.push_back({*time, listed_file(directory, file)});
  }
  if (images.empty()) return fail(ErrorCode::kDamaged, list.string() + ": lists no frame");
  return std::make_unique<ImageListSource>("TUM sequence " + uri.path, std::move(images));
}

std::filesystem::path euroc_camera_folder(const SourceUri& uri) {
  const auto option = uri.options.find("camera");
  const std::string camera = option == uri.options.end() ? "cam0" : option->second;
  const std::filesystem::path directory(uri.path);
  std::error_code ignored;
  const auto whole = directory / "mav0" / camera;
  return std::filesystem::exists(whole, ignored) ? whole : directory / camera;
}

Result<std::unique_ptr<FrameSource>> open_euroc_source(const SourceUri& uri) {
  if (auto status = uri.check_options({"camera"}); !status) return tl::unexpected(status.error());
  const auto folder = euroc_camera_folder(uri);
  const auto list = folder / "data.csv";
  const auto content = read_text_file(list);
  if (!content) {
    auto error = content.error();
    if (error.code == ErrorCode::kNotFound) {
      error.message += "; euroc: needs DIR/mav0/cam0/data.csv (tum:DIR takes a folder with rgb.txt)";
    }
    return tl::unexpected(error);
  }
  std::vector<ListedImage> images;
  for (const auto& line : table_rows(*content)) {
    const size_t comma = std::min(line.text.find(','), line.text.size());
    const auto digits = trim(line.text.substr(0, comma));
    const auto file = trim(line.text.substr(std::min(comma + 1, line.text.size())));
    Timestamp time;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), time.nanoseconds);
    if (error != std::errc() || end != digits.data() + digits.size() || file.empty()) {
      return fail(ErrorCode::kDamaged,
                  at_line(list, line.number, "not a row `time,file` with the time in nanoseconds"));
    }
    images.push_back({time, listed_file(folder / "data", file)});
  }
  if (images.empty()) return fail(ErrorCode::kDamaged, list.string() + ": lists no frame");
  return std::make_unique<ImageListSource>("EuRoC sequence " + folder.string(), std::move(images));
}

Result<std::unique_ptr<FrameSource>> open_images_source(const SourceUri& uri) {
  if (auto status = uri.check_options({"fps"}); !status) return tl::unexpected(status.error());
  const auto fps = uri.positive_number("fps", 30.0);
  if (!fps) return tl::unexpected(fps.error());
  auto paths = images_in(uri.path);
  if (!paths) return tl::unexpected(paths.error());
  std::vector<ListedImage> images;
  for (auto& path : *paths) {
    const double nanoseconds = static_cast<double>(images.size()) * 1e9 / *fps;
    images.push_back({Timestamp{std::llround(nanoseconds)}, std::move(path)});
  }
  return std::make_unique<ImageListSource>("image folder " + uri.path, std::move(images));
}

}  // namespace cairn
