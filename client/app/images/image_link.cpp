// SPDX-License-Identifier: Apache-2.0
#include "client/app/images/image_link.h"

#include <algorithm>
#include <utility>

#include "client/app/images/image_codec.h"
#include "common/base/cpu_time.h"
#include "common/base/utf8.h"
#include "common/wire/partition.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kLease{3000};  // on one host nothing is slow: who is killed is missed soon
constexpr milliseconds kIdle{1000};   // nobody asks, and nobody is asked
constexpr milliseconds kBusy{100};

std::string list_of(const std::vector<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list;
}

}  // namespace

Result<std::unique_ptr<ImageLink>> ImageLink::open(const ImageLinkOptions& options, CameraPtr camera,
                                                   Logger log) {
  wire::ParticipantOptions joining;
  joining.role = wire::Role::kWearerCamera;
  joining.domain = static_cast<uint32_t>(options.domain);
  joining.security = options.security;
  joining.tag += "." + wire::wearer_partition(options.wearer);
  joining.lease = kLease;
  joining.log = log;
  auto participant = wire::Participant::create(joining);
  if (!participant) return tl::unexpected(participant.error());
  auto waiter = wire::Waiter::create(*participant);
  if (!waiter) return tl::unexpected(waiter.error());
  auto made = wire::create_all<wire::Writer<wire::WearerCamera>, wire::Writer<wire::PictureRequest>,
                               wire::Writer<wire::CameraPicture>, wire::Reader<wire::WearerCamera>,
                               wire::Reader<wire::PictureRequest>, wire::Reader<wire::CameraPicture>>(
      *participant, wire::wearer_partition(options.wearer));
  if (!made) return tl::unexpected(made.error());
  auto& [own, requests, images, others, asked, seen] = *made;
  if (Status attached = waiter->attach({others, asked, seen}); !attached)
    return tl::unexpected(attached.error());
  const wire::WearerCamera self{options.name, static_cast<uint32_t>(camera->width()),
                                static_cast<uint32_t>(camera->height())};
  if (Status written = own.write(self); !written) return tl::unexpected(written.error());
  return std::unique_ptr<ImageLink>(new ImageLink(options, std::move(camera), std::move(log),
                                                  *std::move(participant), std::move(own),
                                                  std::move(requests), std::move(images), std::move(others),
                                                  std::move(asked), std::move(seen), *std::move(waiter)));
}

ImageLink::ImageLink(const ImageLinkOptions& options, CameraPtr camera, Logger log,
                     wire::Participant participant, wire::Writer<wire::WearerCamera> own,
                     wire::Writer<wire::PictureRequest> requests, wire::Writer<wire::CameraPicture> images,
                     wire::Reader<wire::WearerCamera> others, wire::Reader<wire::PictureRequest> asked,
                     wire::Reader<wire::CameraPicture> seen, wire::Waiter waiter)
    : options_(options),
      camera_(std::move(camera)),
      log_(std::move(log)),
      participant_(std::move(participant)),
      own_(std::move(own)),
      requests_(std::move(requests)),
      images_(std::move(images)),
      others_(std::move(others)),
      asked_(std::move(asked)),
      seen_(std::move(seen)),
      waiter_(std::move(waiter)),
      demand_(options.name),
      choice_(options.name) {
  thread_ = std::thread([this] { run(); });
}

void ImageLink::close() {
  if (!thread_.joinable()) return;
  ends_ = true;
  waiter_.wake();
  thread_.join();
  tell_demand(steady_clock::now(), {});
  // Who is not told sees that this camera is heard no more.
  (void)requests_.write({options_.name, {}});
  (void)own_.dispose({options_.name});
}

void ImageLink::on_frame(const FrameReport& report) {
  if (!is_asked_) return;
  {
    const std::lock_guard lock(mutex_);
    if (!demand_.take_turn(steady_clock::now())) return;
    frame_ = make_overlay_frame(report);
  }
  waiter_.wake();
}

std::vector<std::string> ImageLink::cameras() {
  const std::lock_guard lock(mutex_);
  return choice_.cameras();
}

void ImageLink::choose(const std::string& camera) {
  {
    const std::lock_guard lock(mutex_);
    if (choice_.chosen() == camera) return;
    choice_.choose(camera, steady_clock::now());
  }
  waiter_.wake();
}

OtherView ImageLink::view() {
  const std::lock_guard lock(mutex_);
  return choice_.view(steady_clock::now());
}

ImageSummary ImageLink::summary() {
  const std::lock_guard lock(mutex_);
  return counts_;
}

void ImageLink::run() {
  while (!ends_) {
    bool is_busy = is_asked_;
    {
      const std::lock_guard lock(mutex_);
      is_busy = is_busy || !choice_.chosen().empty();
    }
    (void)waiter_.wait(is_busy ? kBusy : kIdle);
    try {
      listen();
      ask();
      send();
      tell();
    } catch (const std::exception& error) {  // an image that cannot be drawn must not end the tracker
      if (warning_.due()) log_->error("images of the wearer's cameras: {}", error.what());
    }
  }
}

void ImageLink::listen() {
  wire::take_all(others_, [this](const wire::Sample<wire::WearerCamera>& sample) {
    const std::lock_guard lock(mutex_);
    if (sample.message)
      choice_.come(*sample.message);
    else
      choice_.gone(sample.key.name);
  });
  wire::take_all(asked_, [this](const wire::Sample<wire::PictureRequest>& sample) {
    const std::lock_guard lock(mutex_);
    if (sample.message) demand_.hear(*sample.message, steady_clock::now());
  });
  wire::take_all(seen_, [this](const wire::Sample<wire::CameraPicture>& sample) {
    if (sample.message) receive(*sample.message);
  });
}

void ImageLink::receive(const wire::CameraPicture& message) {
  {
    const std::lock_guard lock(mutex_);
    if (choice_.chosen() != message.name) return;
  }
  auto pixels = decode_camera_image(message.image);
  if (!pixels) {
    log_->debug("an image of {} is dropped: {}", message.name, pixels.error().message);
    return;
  }
  const std::lock_guard lock(mutex_);
  choice_.receive(message, *std::move(pixels), steady_clock::now());
  ++counts_.received;
}

void ImageLink::ask() {
  std::optional<wire::PictureRequest> request;
  {
    const std::lock_guard lock(mutex_);
    request = choice_.request(steady_clock::now());
  }
  if (request) (void)requests_.write(*request);  // it is said again and again
}

/// The camera's image without the status lines: those who get it have room for their own.
void ImageLink::send() {
  std::optional<OverlayFrame> frame;
  {
    const std::lock_guard lock(mutex_);
    frame = std::exchange(frame_, std::nullopt);
  }
  if (!frame) return;
  const auto start = thread_cpu_time();
  if (!overlay_) overlay_.emplace(camera_);
  const cv::Rect area(0, 0, camera_->width() * overlay_->scale(), camera_->height() * overlay_->scale());
  wire::CameraPicture message;
  message.name = options_.name;
  message.time = frame->time;
  message.state = tracking_state_of(frame->state);
  message.map = one_line(frame->map_name);
  const std::string& note = frame->rig.empty() ? frame->note : frame->rig;
  message.note = std::string(cut_text(one_line(note), wire::kMaxCameraPictureNote));
  message.image = encode_camera_image(overlay_->draw(*frame)(area));
  const bool is_sent = images_.write(message).has_value();
  const std::lock_guard lock(mutex_);
  counts_.sent += is_sent ? 1 : 0;
  counts_.cpu += thread_cpu_time() - start;
}

void ImageLink::tell() {
  const MonotonicTime now = steady_clock::now();
  std::vector<std::string> askers;
  OtherView view;
  {
    const std::lock_guard lock(mutex_);
    askers = demand_.askers(now);
    view = choice_.view(now);
  }
  is_asked_ = !askers.empty();
  tell_demand(now, askers);
  std::string said;
  if (!view.camera.empty()) {
    said = !view.is_there            ? "is not there"
           : !is_stale(view)         ? "shows its images"
           : view.age > kImageTooOld ? "has given no image for a second"
                                     : "";
    if (said.empty()) return;
    said = "camera " + view.camera + " of wearer " + options_.wearer + ' ' + said;
  }
  if (said == said_) return;
  if (!said.empty()) log_->info("{}", said);
  said_ = std::move(said);
}

void ImageLink::tell_demand(MonotonicTime now, const std::vector<std::string>& askers) {
  if (askers == askers_) return;
  ImageSummary counts;
  {
    const std::lock_guard lock(mutex_);
    if (!askers_.empty()) counts_.asked += now - asked_since_;
    counts = counts_;
  }
  if (askers.empty()) {
    log_->info("nobody asks for images of this camera any more; {} were sent", counts.sent - sent_before_);
    sent_before_ = counts.sent;
  } else {
    log_->info("images of this camera go to {}", list_of(askers));
  }
  asked_since_ = now;
  askers_ = askers;
}

}  // namespace cairn
