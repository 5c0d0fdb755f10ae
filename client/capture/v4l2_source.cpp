// SPDX-License-Identifier: Apache-2.0
#include "client/capture/v4l2_source.h"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <stdlib.h>  // NOLINT: setenv is POSIX
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <sstream>

#include "common/image/limits.h"
#include "common/io/text.h"

namespace cairn {
namespace {

constexpr const char* kPatienceSeconds = "2";

/// Whether a camera gives its images to another program: most can be opened then all the same, but refuse
/// to be set, even to what they are set to.
bool streams_to_another(int device, uint32_t abilities) {
  v4l2_format format{};
  format.type = (abilities & V4L2_CAP_VIDEO_CAPTURE) != 0 ? V4L2_BUF_TYPE_VIDEO_CAPTURE
                                                          : V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
  return ioctl(device, VIDIOC_G_FMT, &format) == 0 && ioctl(device, VIDIOC_S_FMT, &format) != 0 &&
         errno == EBUSY;
}

/// Checks a camera before OpenCV opens it, and tells why it cannot be used: OpenCV knows only that it cannot
/// open it.
Status check_device(const std::string& path) {
  const auto no_camera = [&](const std::string& why) {
    return fail(ErrorCode::kIo, path + ": " + why + "; `ls /dev/video* /dev/v4l/by-id` shows the cameras");
  };
  const auto busy = [&] {
    return fail(ErrorCode::kIo, path + ": in use by another program; `fuser -v " + path + "` names it");
  };
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) {
    return fail(ErrorCode::kNotFound,
                path + ": no such camera; `ls /dev/video* /dev/v4l/by-id` shows what there is");
  }
  if (!S_ISCHR(info.st_mode)) return no_camera("not a device");
  const int device = open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (device < 0) {
    const int error = errno;
    if (error == EACCES || error == EPERM) {
      return fail(ErrorCode::kIo,
                  path + ": no right to open it; `sudo usermod -aG video $USER`, then log in again");
    }
    if (error == EBUSY) return busy();
    return no_camera(std::string("cannot be opened: ") + std::strerror(error));
  }
  v4l2_capability capability{};
  const bool answered = ioctl(device, VIDIOC_QUERYCAP, &capability) == 0;
  const bool of_this_node = (capability.capabilities & V4L2_CAP_DEVICE_CAPS) != 0;
  const auto abilities = of_this_node ? capability.device_caps : capability.capabilities;
  const bool in_use = answered && streams_to_another(device, abilities);
  close(device);
  if (!answered) return no_camera("is not a camera");
  if ((abilities & (V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_VIDEO_CAPTURE_MPLANE)) == 0) {
    return no_camera("gives no images (cameras also have a node for their metadata)");
  }
  if (in_use) return busy();
  return {};
}

/// Whether the camera that was opened is not there any more.
bool is_gone(const std::string& path) {
  const int device = open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (device < 0) return errno == ENOENT || errno == ENODEV || errno == ENXIO;
  close(device);
  return false;
}

/// A camera of the Linux kernel. Its stamps are of the monotonic clock; they are moved to the epoch by the
/// difference of the clocks at the start, so that setting the wall clock in mid-run does not tear the motion
/// model.
class V4l2Source final : public FrameSource {
 public:
  V4l2Source(std::string path, std::unique_ptr<cv::VideoCapture> capture, ImageSize asked_size,
             double asked_rate)
      : path_(std::move(path)),
        asked_size_(asked_size),
        asked_rate_(asked_rate),
        capture_(std::move(capture)),
        epoch_from_monotonic_(std::chrono::system_clock::now().time_since_epoch() -
                              std::chrono::steady_clock::now().time_since_epoch()) {}

  Result<std::optional<Frame>> next() override {
    if (failures_ >= kMaxFailures) return std::nullopt;
    try {
      const auto start = std::chrono::steady_clock::now();
      if (!capture_->read(pixels_) || pixels_.empty())
        return no_image(std::chrono::steady_clock::now() - start);
      if (pixels_.channels() == 3) {
        cv::cvtColor(pixels_, gray_, cv::COLOR_BGR2GRAY);
      } else {
        gray_ = pixels_;
      }
    } catch (const cv::Exception& error) {
      return failure(error.err);
    }
    failures_ = 0;
    auto image = std::make_shared<const GrayImage>(
        GrayView{gray_.data, gray_.cols, gray_.rows, static_cast<int>(gray_.step)});
    return Frame{index_++, stamp(), std::move(image)};
  }
  std::optional<size_t> frame_count() const override { return std::nullopt; }
  std::optional<ImageSize> image_size() const override {
    return ImageSize{static_cast<int>(capture_->get(cv::CAP_PROP_FRAME_WIDTH)),
                     static_cast<int>(capture_->get(cv::CAP_PROP_FRAME_HEIGHT))};
  }
  std::string describe() const override {
    const ImageSize size = *image_size();
    const double rate = capture_->get(cv::CAP_PROP_FPS);
    const bool tells_rate = rate > 0;
    const bool as_asked =
        size == asked_size_ && (!tells_rate || std::abs(rate - asked_rate_) < kSameRate * asked_rate_);
    return "camera " + path_ + ", " + mode(size, rate) +
           (as_asked ? "" : " (it does not offer the " + mode(asked_size_, asked_rate_) + " asked for)");
  }
  bool is_live() const override { return true; }

 private:
  static constexpr int kMaxFailures = 3;      ///< in a row; each takes up to kPatienceSeconds
  static constexpr double kSameRate = 0.011;  ///< 30 Hz are also given as 29.97 or as a whole number of us

  static std::string mode(ImageSize size, double rate) {
    std::ostringstream text;
    text << size.width << "x" << size.height;
    if (rate > 0) text << " at " << rate << " Hz";
    return text.str();
  }

  tl::unexpected<Error> no_image(std::chrono::nanoseconds waited) {
    if (is_gone(path_)) {
      failures_ = kMaxFailures;
      return fail(ErrorCode::kIo, path_ + ": gone; was it unplugged?");
    }
    if (waited < std::chrono::seconds(1))
      return failure("refuses to give an image; does unplugging it help?");
    return failure("no image for " +
                   std::to_string(std::chrono::round<std::chrono::seconds>(waited).count()) +
                   " s; is it covered by its shutter or asleep?");
  }

  tl::unexpected<Error> failure(const std::string& what) {
    ++failures_;
    return fail(ErrorCode::kIo, path_ + ": " + what);
  }

  [[nodiscard]] Timestamp stamp() const {
    const double milliseconds = capture_->get(cv::CAP_PROP_POS_MSEC);
    const auto monotonic = milliseconds > 0 ? std::chrono::nanoseconds(std::llround(milliseconds * 1e6))
                                            : std::chrono::steady_clock::now().time_since_epoch();
    return Timestamp{(monotonic + epoch_from_monotonic_).count()};
  }

  std::string path_;
  ImageSize asked_size_;
  double asked_rate_;
  std::unique_ptr<cv::VideoCapture> capture_;
  std::chrono::nanoseconds epoch_from_monotonic_;
  cv::Mat pixels_;
  cv::Mat gray_;
  uint64_t index_ = 0;
  int failures_ = 0;
};

/// A side in pixels, 0 if the text is not one.
int parse_side(std::string_view text) {
  const double side = parse_number(text).value_or(0);
  return side >= 1 && side <= kMaxImageSide && side == std::floor(side) ? static_cast<int>(side) : 0;
}

/// "640x480".
Result<ImageSize> parse_size(const std::string& text) {
  const size_t cross = std::min(text.find('x'), text.size());
  const std::string_view view(text);
  const ImageSize size{parse_side(view.substr(0, cross)),
                       parse_side(view.substr(std::min(cross + 1, text.size())))};
  if (size.width == 0 || size.height == 0) {
    return fail(ErrorCode::kUsage, "source option size=" + text + ": not a size such as 640x480");
  }
  return size;
}

}  // namespace

Result<std::unique_ptr<FrameSource>> open_v4l2_source(const SourceUri& uri) {
  if (auto status = uri.check_options({"size", "fps"}); !status) return tl::unexpected(status.error());
  const auto option = uri.options.find("size");
  const auto size = parse_size(option == uri.options.end() ? "640x480" : option->second);
  if (!size) return tl::unexpected(size.error());
  const auto fps = uri.positive_number("fps", 30.0);
  if (!fps) return tl::unexpected(fps.error());
  if (auto status = check_device(uri.path); !status) return tl::unexpected(status.error());
  // OpenCV 4.6 takes its time-out for an image from here only, when the first one is waited for.
  setenv("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", kPatienceSeconds, 0);
  try {
    auto capture = std::make_unique<cv::VideoCapture>(uri.path, cv::CAP_V4L2);
    if (!capture->isOpened()) {
      return fail(ErrorCode::kIo, uri.path + ": gives no format that OpenCV reads; `v4l2-ctl -d " + uri.path +
                                      " --list-formats` shows its formats");
    }
    capture->set(cv::CAP_PROP_FRAME_WIDTH, size->width);
    capture->set(cv::CAP_PROP_FRAME_HEIGHT, size->height);
    capture->set(cv::CAP_PROP_FPS, *fps);
    return std::make_unique<V4l2Source>(uri.path, std::move(capture), *size, *fps);
  } catch (const cv::Exception& exception) {
    return fail(ErrorCode::kIo, uri.path + ": " + exception.err);
  }
}

}  // namespace cairn
