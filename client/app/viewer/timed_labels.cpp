// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/timed_labels.h"

#include <chrono>
#include <utility>

#include "client/app/viewer/controls.h"
#include "common/base/utf8.h"
#include "common/io/text.h"
#include "common/map/label.h"

namespace cairn {
namespace {

constexpr std::chrono::milliseconds kSameFrame(1);
constexpr int kEnter = '\r';

}  // namespace

Result<wire::ClientRequest> ask_for_label(const OverlayFrame& frame, const CameraPtr& camera, cv::Point pixel,
                                          const std::string& text) {
  const MonotonicTime now{};
  ViewerControls window(camera, {});
  window.show(frame);
  window.touch(pixel, {camera->width(), camera->height()}, 1, now);
  if (window.selected()) return fail(ErrorCode::kRefused, "there is a label: " + window.message(now));
  if (window.entry() == nullptr) return fail(ErrorCode::kRefused, window.message(now));
  for (const char32_t character : code_points(text)) window.press(key_code_of(character), now);
  window.press(kEnter, now);
  auto wishes = window.take_wishes();
  if (wishes.requests.empty()) return fail(ErrorCode::kRefused, "a label needs a text");
  return std::move(wishes.requests.front());
}

LabelPlacer::LabelPlacer(const std::vector<TimedLabel>& labels, CameraPtr camera, ViewerLink link, Logger log)
    : waiting_(labels.begin(), labels.end()),
      camera_(std::move(camera)),
      link_(std::move(link)),
      log_(std::move(log)),
      total_(labels.size()) {}

void LabelPlacer::on_frame(const FrameReport& report) {
  while (!waiting_.empty() && report.frame.time >= waiting_.front().time + -kSameFrame) {
    place(report, waiting_.front());
    waiting_.pop_front();
  }
  take_replies();
}

void LabelPlacer::place(const FrameReport& report, const TimedLabel& label) {
  if (report.frame.time - label.time > kSameFrame)
    return log_->warn("frame {}: label {} not placed: the frame of its time was dropped", report.number,
                      in_quotes(label.text));
  auto request = ask_for_label(make_overlay_frame(report), camera_, label.pixel, label.text);
  if (!request)
    return log_->warn("frame {}: label {} not placed: {}", report.number, in_quotes(label.text),
                      request.error().message);
  asked_.push_back(label.text);
  link_.request(std::move(*request));
}

void LabelPlacer::take_replies() {
  for (const RequestReply& reply : link_.take_replies()) {
    if (asked_.empty()) return;
    const std::string text = in_quotes(asked_.front());
    asked_.pop_front();
    kept_ += reply.done ? 1 : 0;
    if (reply.done)
      log_->info("label {} placed", text);
    else
      log_->warn("label {} not placed: refused: {}", text, reply.reason);
  }
}

void LabelPlacer::finish() {
  take_replies();
  for (const TimedLabel& label : waiting_)
    log_->warn("label {} not placed: its time did not come", in_quotes(label.text));
  for (const std::string& text : asked_)
    log_->warn("label {} may not be placed: the server has not answered", in_quotes(text));
  log_->info("labels placed: {} of {}", kept_, total_);
}

}  // namespace cairn
