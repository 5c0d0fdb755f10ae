// SPDX-License-Identifier: Apache-2.0
#include "client/app/video_writer.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <exception>
#include <fstream>
#include <utility>

#include "common/base/time.h"
#include "common/io/text.h"

namespace cairn {
namespace {

constexpr size_t kQueueFrames = 16;
constexpr std::chrono::milliseconds kSlice(100);  ///< how long a request to stop may go unheard
constexpr size_t kFramesForRate = 8;              ///< the rate is taken from the stamps of so many frames
constexpr double kDefaultRate = 30;               ///< [Hz] for a single frame
/// [s] The muxers hold back 5 s at most, and 32 kB, which the whole images among 12 alone fill in less.
constexpr double kLongestStandstill = 20;
constexpr double kLongestStill = 2;  ///< [s] a longer gap of the stamps is a cut, not a pause

struct Codec {
  const char* ending;
  const char* fourcc;
};
/// Encoders that every build of FFmpeg has, and that are cheap: H.264 takes nine times the processor time (29
/// against 3 ms an image of 640x524), which the tracker needs more.
constexpr std::array kCodecs = {Codec{".mp4", "mp4v"}, Codec{".mkv", "mp4v"}, Codec{".avi", "MJPG"}};

const Codec* find_codec(const std::filesystem::path& path) {
  const auto* codec = std::find_if(kCodecs.begin(), kCodecs.end(),
                                   [&path](const Codec& c) { return path.extension() == c.ending; });
  return codec == kCodecs.end() ? nullptr : codec;
}

/// The frame rate [Hz], from the median step between the stamps.
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

Status VideoWriter::check_path(const std::filesystem::path& path) {
  if (find_codec(path) == nullptr)
    return fail(ErrorCode::kUsage, path.string() + ": a video file ends in .mp4, .mkv or .avi");
  std::error_code unknown;
  const auto type = std::filesystem::status(path, unknown).type();
  const bool is_stream = type == std::filesystem::file_type::fifo ||
                         type == std::filesystem::file_type::socket ||
                         type == std::filesystem::file_type::character;
  if (is_stream)
    return fail(ErrorCode::kUsage,
                path.string() +
                    ": a video is written to a file, not to a pipe or device: its index goes back "
                    "to the beginning; name a file");
  return {};
}

Result<std::unique_ptr<VideoWriter>> VideoWriter::open(const std::filesystem::path& path, CameraPtr camera,
                                                       WhenBehind when_behind, StopRequested stop_requested,
                                                       Logger log) {
  if (auto status = check_path(path); !status) return tl::unexpected(status.error());
  if (!std::ofstream(path, std::ios::binary | std::ios::trunc)) {
    return fail(ErrorCode::kIo, cannot_be_written(path));
  }
  return std::unique_ptr<VideoWriter>(new VideoWriter(
      path, std::move(camera), when_behind, std::move(stop_requested), std::move(log)));  // NOLINT: private
}

VideoWriter::VideoWriter(std::filesystem::path path, CameraPtr camera, WhenBehind when_behind,
                         StopRequested stop_requested, Logger log)
    : path_(std::move(path)),
      when_behind_(when_behind),
      stop_requested_(std::move(stop_requested)),
      log_(std::move(log)),
      overlay_(std::move(camera)),
      thread_([this] { run(); }) {}

VideoWriter::~VideoWriter() {
  if (thread_.joinable()) (void)finish();
}

void VideoWriter::push(OverlayFrame frame) {
  const auto has_room = [this] { return done_ || queue_.size() < kQueueFrames; };
  std::unique_lock lock(mutex_);
  bool waits = when_behind_ == WhenBehind::kWait;
  while (waits && !changed_.wait_for(lock, kSlice, has_room)) waits = !stop_requested_();
  if (done_) return;  // finish() says why
  if (!has_room()) {
    ++images_dropped_;
    return;
  }
  queue_.push_back(std::move(frame));
  changed_.notify_all();
}

Status VideoWriter::finish() {
  std::unique_lock lock(mutex_);
  finishing_ = true;
  changed_.notify_all();
  // Whoever asks hears the first signal, and the second then has its default effect.
  while (!changed_.wait_for(lock, kSlice, [this] { return done_; })) (void)stop_requested_();
  lock.unlock();
  thread_.join();
  return status_;
}

/// Encodes until the end. What the encoder throws is a fault of the file, not of the program.
void VideoWriter::run() {
  try {
    encode();
  } catch (const std::exception& error) {
    status_ = fail(ErrorCode::kIo, path_.string() + ": cannot be encoded: " + error.what());
  }
  const std::lock_guard lock(mutex_);
  done_ = true;
  queue_.clear();
  changed_.notify_all();
}

std::optional<OverlayFrame> VideoWriter::next() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return finishing_ || !queue_.empty(); });
  if (queue_.empty()) return std::nullopt;
  OverlayFrame frame = std::move(queue_.front());
  queue_.pop_front();
  changed_.notify_all();
  return frame;
}

void VideoWriter::encode() {
  while (auto frame = next()) {
    if (file_.isOpened()) {
      write(*frame);
      continue;
    }
    first_frames_.push_back(std::move(*frame));
    if (first_frames_.size() < kFramesForRate) continue;
    if (status_ = open_file(); !status_) return;
  }
  if (!file_.isOpened() && !first_frames_.empty()) status_ = open_file();
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

/// OpenCV does not say when an image could not be written; what was cut short cannot be read back to its
/// end.
Status VideoWriter::check_file() const {
  // Not the last image: Matroska has rounded times, and a long file's count is off by some from them.
  constexpr double kNearTheEnd = 0.99;
  const double place = std::floor(kNearTheEnd * static_cast<double>(images_written_ - 1));
  cv::VideoCapture file(path_.string(), cv::CAP_FFMPEG);
  if (file.isOpened() && file.set(cv::CAP_PROP_POS_FRAMES, place) &&
      file.get(cv::CAP_PROP_POS_FRAMES) >= place && file.grab()) {
    return {};
  }
  return fail(ErrorCode::kIo, path_.string() + ": is not complete; is the disk full?");
}

/// A gap in the stamps is filled with the image before it.
void VideoWriter::write(const OverlayFrame& frame) {
  const double since_start = seconds_between(frame.time, start_);
  auto place = std::llround(since_start * frame_rate_);
  const auto longest = std::llround(kLongestStill * frame_rate_);
  if (place < images_written_ - longest || place > images_written_ + longest) {
    const auto written_ns = std::llround(static_cast<double>(images_written_) / frame_rate_ * 1e9);
    start_ = frame.time + std::chrono::nanoseconds(-written_ns);
    place = images_written_;
  }
  for (; images_written_ < place; ++images_written_) file_.write(image_);
  image_ = overlay_.draw(frame);
  file_.write(image_);
  ++images_written_;
  watch_growth();
}

/// OpenCV does not say when an image could not be written; a file that grows no more does.
void VideoWriter::watch_growth() {
  std::error_code unknown;
  const uintmax_t bytes = std::filesystem::file_size(path_, unknown);
  if (std::exchange(bytes_, bytes) != bytes) images_at_growth_ = images_written_;
  const double still = static_cast<double>(images_written_ - images_at_growth_) / frame_rate_;
  if (still < kLongestStandstill || std::exchange(standstill_told_, true)) return;
  log_->error("{}: does not grow any more; is the disk full? going on", path_.string());
}

}  // namespace cairn
