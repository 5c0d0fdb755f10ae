// SPDX-License-Identifier: Apache-2.0
#include "client/app/images/image_choice.h"

#include <utility>

#include "client/app/images/image_codec.h"

namespace cairn {
namespace {

using std::chrono::duration_cast;
using std::chrono::milliseconds;
using std::chrono::seconds;

}  // namespace

std::string describe(const OtherView& view) {
  const std::string since = std::to_string(duration_cast<seconds>(view.age).count()) + " s";
  if (!view.is_there) {
    return view.camera + (view.pixels.empty() ? ": is not there" : ": has gone") +
           "; its cairn-track does not run on this host";
  }
  if (view.pixels.empty())
    return view.camera + (view.age > kImageTooOld ? ": no image for " + since : ": is asked for");
  if (is_stale(view)) return view.camera + ": STOPPED, the image is " + since + " old";
  std::string text = view.camera + ": " + to_string(view.state);
  if (!view.map.empty()) text += ", " + view.map;
  if (!view.note.empty()) text += "; " + view.note;
  return text;
}

void ImageChoice::come(const wire::WearerCamera& camera) {
  if (camera.name != name_) cameras_.insert(camera.name);
}

void ImageChoice::choose(const std::string& camera, MonotonicTime now) {
  if (camera == view_.camera) return;
  ends_ = camera.empty();
  view_ = {};
  view_.camera = camera;
  since_ = now;
  said_.reset();
}

std::optional<wire::PictureRequest> ImageChoice::request(MonotonicTime now) {
  if (std::exchange(ends_, false)) return wire::PictureRequest{name_, {}};
  if (view_.camera.empty() || (said_ && now - *said_ < kPictureRequestPeriod)) return std::nullopt;
  said_ = now;
  return wire::PictureRequest{name_, view_.camera};
}

void ImageChoice::receive(const wire::CameraPicture& message, cv::Mat pixels, MonotonicTime now) {
  if (message.name != view_.camera) return;
  view_.pixels = std::move(pixels);
  view_.state = frame_state_of(message.state);
  view_.map = message.map;
  view_.note = message.note;
  since_ = now;
}

OtherView ImageChoice::view(MonotonicTime now) const {
  OtherView view = view_;
  view.is_there = cameras_.contains(view.camera);
  view.age = duration_cast<milliseconds>(now - since_);
  return view;
}

}  // namespace cairn
