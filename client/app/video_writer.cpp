// SPDX-License-Identifier: Apache-2.0
#include "client/app/video_writer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <utility>

#include "common/base/time.h"
#include "common/io/text.h"

namespace cairn {
namespace {

constexpr size_t kQueueFrames = 16;
constexpr size_t kFramesForRate = 8;  ///< the rate is taken from the stamps of so many frames
constexpr double kDefaultRate = 30;   ///< [Hz] for a single frame
constexpr double kLongestStill = 2;   ///< [s] a longer gap of the stamps is a cut, not a pause

struct Codec {
  const char* ending;
  const char* fourcc;
};
/// In every build of FFmpeg, and cheap: H.264 takes nine times the processor time (29 against 3 ms a picture
/// of 640x524), which the tracker needs more.
constexpr std::array kCodecs = {Codec{".mp4", "mp4v"}, Codec{".mkv", "mp4v"}, Codec{".avi", "MJPG"}};

const Codec* find_codec(const std::filesystem::path& path) {
  const auto* codec = std::find_if(kCodecs.begin(), kCodecs.end(),
                                   [&path](const Codec& c) { return path.extension() == c.ending; });
  return codec == kCodecs.end() ? nullptr : codec;
}

/// From the median step between the stamps.
double rate_of(const std::vector<OverlayFrame>& frames) {
  std::vector<double> steps;
  for (size_t i = 1; i < frames.size(); ++i) {
    const double step = seconds_between(frames[i].time, frames[i - 1].time);
    if (step > 0) steps.push_back(step);
  }
  if (steps.empty()) return kDefaultRate;
  const auto median = steps.begin() + static_cast<ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), median, steps.end());
  return std::clamp(1.0 / *median, 1.0, 120.0);
}

}  // namespace

Status VideoWriter::check_ending(const std::filesystem::path& path) {
  if (find_codec(path) != nullptr) return {};
  return fail(ErrorCode::kUsage, path.string() + ": a video file ends in .mp4, .mkv or .avi");
}

Result<std::unique_ptr<VideoWriter>> VideoWriter::open(const std::filesystem::path& path, CameraPtr camera,
                                                       WhenBehind when_behind) {
  if (auto status = check_ending(path); !status) return tl::unexpected(status.error());
  if (!std::ofstream(path, std::ios::binary | std::ios::trunc)) {
    return fail(ErrorCode::kIo, cannot_be_written(path));
  }
  return std::unique_ptr<VideoWriter>(
      new VideoWriter(path, std::move(camera), when_behind));  // NOLINT: private
}

VideoWriter::VideoWriter(std::filesystem::path path, CameraPtr camera, WhenBehind when_behind)
    : path_(std::move(path)),
      when_behind_(when_behind),
      overlay_(std::move(camera)),
      thread_([this] { run(); }) {}

VideoWriter::~VideoWriter() {
  if (thread_.joinable()) (void)finish();
}

void VideoWriter::push(OverlayFrame frame) {
  std::unique_lock lock(mutex_);
  if (when_behind_ == WhenBehind::kDropPictures && queue_.size() >= kQueueFrames) {
    ++pictures_dropped_;
    return;
  }
  changed_.wait(lock, [this] { return queue_.size() < kQueueFrames; });
  queue_.push_back(std::move(frame));
  changed_.notify_all();
}

Status VideoWriter::finish() {
  {
    const std::lock_guard lock(mutex_);
    finishing_ = true;
  }
  changed_.notify_all();
  thread_.join();
  return status_;
}

void VideoWriter::run() {
  while (true) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return finishing_ || !queue_.empty(); });
    if (queue_.empty()) break;
    OverlayFrame frame = std::move(queue_.front());
    queue_.pop_front();
    changed_.notify_all();
    lock.unlock();
    if (file_.isOpened()) {
      write(frame);
    } else if (status_) {
      first_frames_.push_back(std::move(frame));
      if (first_frames_.size() >= kFramesForRate) status_ = open_file();
    }
  }
  if (!file_.isOpened() && status_ && !first_frames_.empty()) status_ = open_file();
  if (!file_.isOpened()) return;
  file_.release();
  status_ = check_file();
}

Status VideoWriter::open_file() {
  frame_rate_ = rate_of(first_frames_);
  start_ = first_frames_.front().time;
  const char* code = find_codec(path_)->fourcc;
  const int fourcc = cv::VideoWriter::fourcc(code[0], code[1], code[2], code[3]);
  if (!file_.open(path_.string(), cv::CAP_FFMPEG, fourcc, frame_rate_, overlay_.size())) {
    return fail(ErrorCode::kIo, path_.string() + ": cannot be begun as " + code +
                                    " video; is the disk full, or OpenCV built without FFmpeg?");
  }
  for (const auto& frame : first_frames_) write(frame);
  first_frames_.clear();
  return {};
}

/// OpenCV does not say when a picture could not be written; what was cut short cannot be read back to its
/// end.
Status VideoWriter::check_file() const {
  // Not the last picture: Matroska has rounded times, and a long file's count is off by some from them.
  constexpr double kNearTheEnd = 0.99;
  const double place = std::floor(kNearTheEnd * static_cast<double>(pictures_written_ - 1));
  cv::VideoCapture file(path_.string(), cv::CAP_FFMPEG);
  if (file.isOpened() && file.set(cv::CAP_PROP_POS_FRAMES, place) &&
      file.get(cv::CAP_PROP_POS_FRAMES) >= place && file.grab()) {
    return {};
  }
  return fail(ErrorCode::kIo, path_.string() + ": is not complete; is the disk full?");
}

/// A gap in the stamps is filled with the picture before it.
void VideoWriter::write(const OverlayFrame& frame) {
  const double since_start = seconds_between(frame.time, start_);
  auto place = std::llround(since_start * frame_rate_);
  const auto longest = std::llround(kLongestStill * frame_rate_);
  if (place < pictures_written_ - longest || place > pictures_written_ + longest) {
    const auto written_ns = std::llround(static_cast<double>(pictures_written_) / frame_rate_ * 1e9);
    start_ = frame.time + std::chrono::nanoseconds(-written_ns);
    place = pictures_written_;
  }
  for (; pictures_written_ < place; ++pictures_written_) file_.write(picture_);
  picture_ = overlay_.draw(frame);
  file_.write(picture_);
  ++pictures_written_;
}

}  // namespace cairn
