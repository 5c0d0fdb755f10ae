// SPDX-License-Identifier: Apache-2.0
#include "client/capture/video_source.h"

#include <fmt/format.h>

#include <cmath>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <vector>

#include "client/capture/stamp_check.h"
#include "client/capture/stamp_list.h"

namespace cairn {
namespace {

/// Share of the frames that the container announces with which a video counts as whole. Some containers
/// announce what duration and rate make, a few more than there are.
constexpr double kWholeShare = 0.95;

/// The angle [degrees] by which the image is to be turned clockwise so that it is upright, from what the
/// container says: phones keep the rows of the sensor and say how it was held. OpenCV must not turn it by
/// itself: OpenCV 4.6 would turn the wrong way, for it gives the angle with the other sign.
int clockwise_turn(cv::VideoCapture& capture) {
  capture.set(cv::CAP_PROP_ORIENTATION_AUTO, 0);
  const int angle = static_cast<int>(std::lround(capture.get(cv::CAP_PROP_ORIENTATION_META)));
  const bool is_counterclockwise = cv::getVersionMajor() == 4 && cv::getVersionMinor() == 6;
  return ((is_counterclockwise ? -angle : angle) % 360 + 360) % 360;
}

/// OpenCV's turn for an angle. Nothing where the image is to stay, or at an angle that rows of pixels cannot
/// have.
std::optional<cv::RotateFlags> turn_of(int clockwise_degrees) {
  switch (clockwise_degrees) {
    case 90:
      return cv::ROTATE_90_CLOCKWISE;
    case 180:
      return cv::ROTATE_180;
    case 270:
      return cv::ROTATE_90_COUNTERCLOCKWISE;
    default:
      return std::nullopt;
  }
}

/// Notes for a person about the stamps of a container, by its first frames and a capture of their own: stamps
/// are known only when frames are taken.
std::vector<SourceNote> vet_container(const std::string& path) {
  constexpr size_t kFrames = 12;
  cv::VideoCapture capture(path, cv::CAP_FFMPEG);
  std::vector<Timestamp> stamps;
  while (stamps.size() < kFrames && capture.grab())
    stamps.push_back({std::llround(capture.get(cv::CAP_PROP_POS_MSEC) * 1e6)});
  auto report = check_stamps(stamps, TimeUnit::kSeconds);
  if (report.impossible) report.remarks = {*report.impossible};
  std::vector<SourceNote> notes;
  for (const auto& remark : report.remarks)
    notes.push_back({path + ": " + remark + "; times=FILE gives its frames other stamps", true});
  return notes;
}

/// Frames of a video file, upright as players show them, stamped by a list of times or else by the container.
class VideoSource final : public FrameSource {
 public:
  VideoSource(std::string path, std::unique_ptr<cv::VideoCapture> capture, std::string times_path,
              std::vector<Timestamp> times, std::vector<SourceNote> notes)
      : path_(std::move(path)),
        times_path_(std::move(times_path)),
        capture_(std::move(capture)),
        times_(std::move(times)),
        notes_(std::move(notes)),
        turn_(clockwise_turn(*capture_)),
        container_count_(std::max(0.0, capture_->get(cv::CAP_PROP_FRAME_COUNT))),
        frame_period_(period_of(*capture_)) {
    if (!turn_of(turn_)) return;
    const auto size = *image_size();
    notes_.push_back(
        {fmt::format("{}: its images are turned by {} degrees clockwise, as the file says and as "
                     "players show it; the calibration is for upright images of {}x{}",
                     path_, turn_, size.width, size.height)});
  }

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
      if (const auto turn = turn_of(turn_)) cv::rotate(gray_, gray_, *turn);
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
  std::optional<ImageSize> image_size() const override {
    const ImageSize size{static_cast<int>(capture_->get(cv::CAP_PROP_FRAME_WIDTH)),
                         static_cast<int>(capture_->get(cv::CAP_PROP_FRAME_HEIGHT))};
    return turn_ % 180 == 90 ? ImageSize{size.height, size.width} : size;
  }
  std::vector<SourceNote> notes() const override { return notes_; }
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
  std::vector<SourceNote> notes_;
  int turn_;  ///< clockwise [degrees]
  double container_count_;
  std::chrono::nanoseconds frame_period_;
  std::optional<Timestamp> last_time_;
  cv::Mat pixels_;
  cv::Mat gray_;
  uint64_t index_ = 0;
  bool at_end_ = false;
};

}  // namespace

Result<std::unique_ptr<FrameSource>> open_video_source(const SourceUri& uri) {
  if (auto status = uri.check_options({"times", "unit"}); !status) return tl::unexpected(status.error());
  std::string times_path;
  std::vector<Timestamp> times;
  std::vector<SourceNote> notes;
  if (const auto option = uri.options.find("times"); option != uri.options.end()) {
    times_path = option->second;
    const auto unit = stamp_unit(uri, TimeUnit::kSeconds);
    if (!unit) return tl::unexpected(unit.error());
    auto read = read_times(times_path, unit->unit);
    if (!read) return tl::unexpected(read.error());
    times = std::move(*read);
    auto vetted = vet_stamps(times_path, times, *unit);
    if (!vetted) return tl::unexpected(vetted.error());
    notes = std::move(*vetted);
  }
  std::error_code error;
  if (!std::filesystem::is_regular_file(uri.path, error)) {
    return fail(ErrorCode::kNotFound, uri.path + ": no such video file");
  }
  try {
    // FFmpeg by name: the image-sequence back end would take a file name with digits in it for a pattern.
    auto capture = std::make_unique<cv::VideoCapture>(uri.path, cv::CAP_FFMPEG);
    if (!capture->isOpened()) return fail(ErrorCode::kDamaged, uri.path + ": not a video that FFmpeg reads");
    if (times_path.empty()) notes = vet_container(uri.path);
    return std::make_unique<VideoSource>(uri.path, std::move(capture), std::move(times_path),
                                         std::move(times), std::move(notes));
  } catch (const cv::Exception& exception) {
    return fail(ErrorCode::kDamaged, uri.path + ": " + exception.err);
  }
}

}  // namespace cairn
