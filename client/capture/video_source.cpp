// SPDX-License-Identifier: Apache-2.0
#include "client/capture/video_source.h"

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <vector>

#include "common/io/text.h"

namespace cairn {
namespace {

/// Of the frames that the container announces: some announce what duration and rate make, a few more than
/// there are.
constexpr double kWholeShare = 0.95;

/// Frames of a video file, stamped by a list of times or else by the container.
class VideoSource final : public FrameSource {
 public:
  VideoSource(std::string path, std::unique_ptr<cv::VideoCapture> capture, std::string times_path,
              std::vector<Timestamp> times)
      : path_(std::move(path)),
        times_path_(std::move(times_path)),
        capture_(std::move(capture)),
        times_(std::move(times)),
        container_count_(std::max(0.0, capture_->get(cv::CAP_PROP_FRAME_COUNT))),
        frame_period_(period_of(*capture_)) {}

  Result<std::optional<Frame>> next() override {
    if (at_end_) return std::nullopt;
    try {
      if (!capture_->read(pixels_)) return end_of_video();
      if (has_times() && index_ >= times_.size()) {
        at_end_ = true;
        return fail(ErrorCode::kDamaged, times_path_ + ": " + std::to_string(times_.size()) + " times, but " +
                                             path_ + " has more frames; the rest is left out");
      }
      cv::cvtColor(pixels_, gray_, cv::COLOR_BGR2GRAY);
    } catch (const cv::Exception& error) {
      at_end_ = true;
      return fail(ErrorCode::kDamaged, path_ + ": frame " + std::to_string(index_) + ": " + error.err);
    }
    const Timestamp time = has_times() ? times_[index_] : container_time();
    auto image = std::make_shared<const GrayImage>(
        GrayView{gray_.data, gray_.cols, gray_.rows, static_cast<int>(gray_.step)});
    return Frame{index_++, time, std::move(image)};
  }
  std::optional<size_t> frame_count() const override {
    if (has_times()) return times_.size();
    if (container_count_ < 1) return std::nullopt;  // a stream without a length
    return static_cast<size_t>(container_count_);
  }
  std::optional<PictureSize> picture_size() const override {
    return PictureSize{static_cast<int>(capture_->get(cv::CAP_PROP_FRAME_WIDTH)),
                       static_cast<int>(capture_->get(cv::CAP_PROP_FRAME_HEIGHT))};
  }
  std::string describe() const override {
    return "video " + path_ + (has_times() ? ", times from " + times_path_ : "");
  }

 private:
  [[nodiscard]] bool has_times() const { return !times_path_.empty(); }

  static std::chrono::nanoseconds period_of(cv::VideoCapture& capture) {
    const double fps = capture.get(cv::CAP_PROP_FPS);
    return std::chrono::nanoseconds(fps > 1e-3 && fps < 1e6 ? std::llround(1e9 / fps) : 33'333'333);
  }

  /// OpenCV reports the end and a damaged stream alike; with a list of times the difference shows.
  Result<std::optional<Frame>> end_of_video() {
    at_end_ = true;
    if (has_times() && index_ < times_.size()) {
      return fail(ErrorCode::kDamaged, path_ + ": ends after frame " + std::to_string(index_) + " of the " +
                                           std::to_string(times_.size()) + " in " + times_path_ +
                                           "; is it cut short?");
    }
    if (index_ == 0) return fail(ErrorCode::kDamaged, path_ + ": no frame in it can be decoded");
    if (static_cast<double>(index_) < kWholeShare * container_count_) {
      return fail(ErrorCode::kDamaged, path_ + ": ends after frame " + std::to_string(index_) + " of " +
                                           std::to_string(static_cast<size_t>(container_count_)) +
                                           "; is it cut short?");
    }
    return std::nullopt;
  }

  /// Some containers carry no or repeated stamps; then the frame comes one period after the last.
  Timestamp container_time() {
    const Timestamp stamp{std::llround(capture_->get(cv::CAP_PROP_POS_MSEC) * 1e6)};
    last_time_ = last_time_ && stamp <= *last_time_ ? *last_time_ + frame_period_ : stamp;
    return *last_time_;
  }

  std::string path_;
  std::string times_path_;  ///< empty without a list of times
  std::unique_ptr<cv::VideoCapture> capture_;
  std::vector<Timestamp> times_;
  double container_count_;
  std::chrono::nanoseconds frame_period_;
  std::optional<Timestamp> last_time_;
  cv::Mat pixels_;
  cv::Mat gray_;
  uint64_t index_ = 0;
  bool at_end_ = false;
};

Result<std::vector<Timestamp>> read_times(const std::filesystem::path& path) {
  const auto content = read_text_file(path);
  if (!content) return tl::unexpected(content.error());
  std::vector<Timestamp> times;
  for (const auto& line : table_rows(*content)) {
    const auto time = parse_timestamp(line.text);
    if (!time) {
      return fail(ErrorCode::kDamaged,
                  at_line(path, line.number, in_quotes(line.text) + " is not one time in seconds"));
    }
    times.push_back(*time);
  }
  if (times.empty()) return fail(ErrorCode::kDamaged, path.string() + ": no time in it");
  return times;
}

}  // namespace

Result<std::unique_ptr<FrameSource>> open_video_source(const SourceUri& uri) {
  if (auto status = uri.check_options({"times"}); !status) return tl::unexpected(status.error());
  std::string times_path;
  std::vector<Timestamp> times;
  if (const auto option = uri.options.find("times"); option != uri.options.end()) {
    times_path = option->second;
    auto read = read_times(times_path);
    if (!read) return tl::unexpected(read.error());
    times = std::move(*read);
  }
  std::error_code error;
  if (!std::filesystem::is_regular_file(uri.path, error)) {
    return fail(ErrorCode::kNotFound, uri.path + ": no such video file");
  }
  try {
    // FFmpeg by name: the image-sequence back end would take a file name with digits in it for a pattern.
    auto capture = std::make_unique<cv::VideoCapture>(uri.path, cv::CAP_FFMPEG);
    if (!capture->isOpened()) return fail(ErrorCode::kDamaged, uri.path + ": not a video that FFmpeg reads");
    return std::make_unique<VideoSource>(uri.path, std::move(capture), std::move(times_path),
                                         std::move(times));
  } catch (const cv::Exception& exception) {
    return fail(ErrorCode::kDamaged, uri.path + ": " + exception.err);
  }
}

}  // namespace cairn
