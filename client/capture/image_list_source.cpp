// SPDX-License-Identifier: Apache-2.0
#include "client/capture/image_list_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "client/capture/image_folder.h"
#include "client/capture/image_sample.h"
#include "client/capture/stamp_list.h"
#include "common/io/image_file.h"
#include "common/io/orientation.h"
#include "common/io/text.h"

namespace cairn {
namespace {

/// Images and their times, in the order of the frames.
struct ImageList {
  std::string description;
  std::vector<std::filesystem::path> paths;
  std::vector<Timestamp> times;
  std::vector<SourceNote> notes;
};

std::string size_text(ImageSize size) {
  return fmt::format("{}x{}", size.width, size.height);
}

/// Frames that are files of their own: the lists of TUM and EuRoC, and the image folder.
class ImageListSource final : public FrameSource {
 public:
  ImageListSource(ImageList list, ImageSample sample) : list_(std::move(list)), sample_(sample) {
    note_orientation();
    if (!sample_.levels) return;
    const GrayLevels& levels = *sample_.levels;
    list_.notes.push_back(
        {fmt::format("{}: the grey values {} to {} of 65535 are used{}; they are read as 0 to "
                     "255, in all images alike",
                     list_.description, levels.black, levels.white,
                     levels.exchange_bytes ? ", with the low byte first" : "")});
  }

  Result<std::optional<Frame>> next() override {
    if (next_ == list_.paths.size()) return std::nullopt;
    const uint64_t index = next_++;
    const auto& path = list_.paths[index];
    auto image = read_gray_image(path, sample_.levels);
    if (!image) return tl::unexpected(image.error());
    const ImageSize size{image->width(), image->height()};
    if (sample_.size && size != *sample_.size) {
      return fail(ErrorCode::kDamaged, fmt::format("{}: is {}, the others are {}", path.string(),
                                                   size_text(size), size_text(*sample_.size)));
    }
    return Frame{index, list_.times[index], std::make_shared<const GrayImage>(std::move(*image))};
  }
  std::optional<size_t> frame_count() const override { return list_.paths.size(); }
  std::optional<std::pair<Timestamp, Timestamp>> time_span() const override {
    if (list_.times.empty()) return std::nullopt;
    const auto [first, last] = std::minmax_element(list_.times.begin(), list_.times.end());
    return std::pair(*first, *last);
  }
  std::optional<ImageSize> image_size() const override { return sample_.size; }
  std::vector<SourceNote> notes() const override { return list_.notes; }
  std::string describe() const override {
    return list_.description + ", " + std::to_string(list_.paths.size()) + " images";
  }

 private:
  void note_orientation() {
    const auto& found = sample_.orientations;
    if (found.empty() || found == std::set{kUpright}) return;
    std::string words;
    for (const int orientation : found) {
      words += words.empty() ? "" : ", or ";
      words += orientation == kUpright ? "left as they are" : orientation_words(orientation);
    }
    const bool is_mixed = found.size() > 1;
    list_.notes.push_back(
        {fmt::format("{}: its images are {}, as the files say and as viewers show them; the calibration is "
                     "for upright images of {}{}",
                     list_.description, words, size_text(*sample_.size),
                     is_mixed ? ", and it holds for one way only in which the camera was held" : ""),
         is_mixed});
  }

  ImageList list_;
  ImageSample sample_;
  size_t next_ = 0;
};

std::unique_ptr<FrameSource> make_source(ImageList list) {
  const auto sample = sample_images(list.paths);
  return std::make_unique<ImageListSource>(std::move(list), sample);
}

/// How a recording lists its frames: rows of a time, a separator and a file.
struct ListFormat {
  std::string_view separators;
  std::string_view row;   ///< for a person
  TimeUnit unit;          ///< unless the source says another
  std::string_view hint;  ///< where there is no list
};
constexpr ListFormat kTum = {
    " \t", "time file", TimeUnit::kSeconds,
    "tum: needs this list of rows `time file` (images:DIR takes a folder without one)"};
constexpr ListFormat kEuroc = {",", "time,file", TimeUnit::kNanoseconds,
                               "euroc: needs DIR/mav0/cam0/data.csv (tum:DIR takes a folder with rgb.txt)"};

Result<std::unique_ptr<FrameSource>> open_list(const SourceUri& uri, const ListFormat& format,
                                               const std::filesystem::path& file,
                                               const std::filesystem::path& images, std::string description) {
  const auto unit = stamp_unit(uri, format.unit);
  if (!unit) return tl::unexpected(unit.error());
  const auto content = read_text_file(file);
  if (!content) {
    auto error = content.error();
    if (error.code == ErrorCode::kNotFound) error.message += fmt::format("; {}", format.hint);
    return tl::unexpected(error);
  }
  ImageList list{std::move(description), {}, {}, {}};
  size_t companions = 0;
  for (const auto& line : table_rows(*content)) {
    const size_t end = std::min(line.text.find_first_of(format.separators), line.text.size());
    const auto stamp = trim(line.text.substr(0, end));
    const auto name = trim(line.text.substr(std::min(end + 1, line.text.size())));
    const auto time = parse_stamp(stamp, unit->unit);
    if (!time || name.empty()) {
      return fail(ErrorCode::kDamaged, at_line(file, line.number,
                                               fmt::format("not a row `{}` with the time in {}{}", format.row,
                                                           long_name(unit->unit),
                                                           time ? "" : other_unit_hint(stamp, unit->unit))));
    }
    const auto path = listed_file(images, name);
    if (is_hidden(path)) {
      ++companions;
      continue;
    }
    list.paths.push_back(path);
    list.times.push_back(*time);
  }
  if (list.paths.empty()) return fail(ErrorCode::kDamaged, file.string() + ": lists no frame");
  auto notes = vet_stamps(file, list.times, *unit);
  if (!notes) return tl::unexpected(notes.error());
  list.notes = std::move(*notes);
  if (companions > 0)
    list.notes.push_back(
        {fmt::format("{}: {} hidden files (as ._a.jpg) are no frames", file.string(), companions)});
  return make_source(std::move(list));
}

/// The times of an image folder: those of its list, or its rate.
Status stamp_images(const SourceUri& uri, ImageList& list) {
  const auto fps = uri.positive_number("fps", 30.0);
  if (!fps) return tl::unexpected(fps.error());
  const auto file = uri.options.find("times");
  if (file == uri.options.end()) {
    for (size_t i = 0; i < list.paths.size(); ++i)
      list.times.push_back({std::llround(static_cast<double>(i) * 1e9 / *fps)});
    return {};
  }
  if (uri.options.contains("fps"))
    return fail(ErrorCode::kUsage, "source options fps and times: both stamp the images; give one of them");
  const auto unit = stamp_unit(uri, TimeUnit::kSeconds);
  if (!unit) return tl::unexpected(unit.error());
  auto times = read_times(file->second, unit->unit);
  if (!times) return tl::unexpected(times.error());
  if (times->size() != list.paths.size()) {
    return fail(ErrorCode::kDamaged, fmt::format("{}: {} times, but {} has {} images", file->second,
                                                 times->size(), uri.path, list.paths.size()));
  }
  const auto notes = vet_stamps(file->second, *times, *unit);
  if (!notes) return tl::unexpected(notes.error());
  list.times = std::move(*times);
  list.notes.insert(list.notes.end(), notes->begin(), notes->end());
  list.description += ", times from " + file->second;
  return {};
}

}  // namespace

Result<std::unique_ptr<FrameSource>> open_tum_source(const SourceUri& uri) {
  if (auto status = uri.check_options({"unit"}); !status) return tl::unexpected(status.error());
  const std::filesystem::path directory(uri.path);
  return open_list(uri, kTum, directory / "rgb.txt", directory, "TUM sequence " + uri.path);
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
  if (auto status = uri.check_options({"camera", "unit"}); !status) return tl::unexpected(status.error());
  const auto folder = euroc_camera_folder(uri);
  return open_list(uri, kEuroc, folder / "data.csv", folder / "data", "EuRoC sequence " + folder.string());
}

Result<std::unique_ptr<FrameSource>> open_images_source(const SourceUri& uri) {
  if (auto status = uri.check_options({"fps", "times", "unit", "match"}); !status)
    return tl::unexpected(status.error());
  const auto option = uri.options.find("match");
  auto folder =
      list_images(uri.path, option == uri.options.end() ? std::nullopt : std::optional(option->second));
  if (!folder) return tl::unexpected(folder.error());
  ImageList list{"image folder " + uri.path, std::move(folder->files), {}, {}};
  if (folder->hidden > 0) {
    list.notes.push_back(
        {fmt::format("{}: {} hidden files (as ._a.jpg) are no frames", uri.path, folder->hidden)});
  }
  if (auto status = stamp_images(uri, list); !status) return tl::unexpected(status.error());
  return make_source(std::move(list));
}

}  // namespace cairn
