// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/timed_labels.h"

#include <algorithm>
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

/// The rest of a row after its first `count` fields.
std::string_view rest_after(std::string_view row, int count) {
  for (; count > 0; --count) {
    row.remove_prefix(std::min(row.find_first_of(" \t"), row.size()));
    row = trim(row);
  }
  return row;
}

Result<TimedLabel> parse_row(std::string_view row, cv::Size picture) {
  const auto fields = split_fields(row);
  const auto time = fields.size() >= 4 ? parse_timestamp(fields[0]) : std::nullopt;
  const auto x = time ? parse_number(fields[1]) : std::nullopt;
  const auto y = x ? parse_number(fields[2]) : std::nullopt;
  if (!y) return fail(ErrorCode::kDamaged, "expected `timestamp x y text`");
  if (!(*x >= 0 && *x < picture.width && *y >= 0 && *y < picture.height)) {
    return fail(ErrorCode::kDamaged, "the pixel lies outside the picture, which is " +
                                         std::to_string(picture.width) + "x" +
                                         std::to_string(picture.height));
  }
  const std::string_view text = rest_after(row, 3);
  if (const auto fault = fault_of_text(text))
    return fail(ErrorCode::kDamaged, "the text " + in_quotes(text) + " is none: " + *fault);
  if (is_invisible(text) || text.size() > kMaxLabelBytes) {
    return fail(ErrorCode::kDamaged, "a text is 1 to " + std::to_string(kMaxLabelBytes) +
                                         " bytes of UTF-8, not " + in_quotes(text));
  }
  return TimedLabel{*time, {static_cast<int>(*x), static_cast<int>(*y)}, std::string(text)};
}

}  // namespace

Result<std::vector<TimedLabel>> read_timed_labels(const std::filesystem::path& path, cv::Size picture) {
  const auto content = read_text_file(path);
  if (!content) return tl::unexpected(content.error());
  std::vector<TimedLabel> labels;
  for (const TextLine& line : table_rows(*content)) {
    auto label = parse_row(line.text, picture);
    if (!label) return fail(label.error().code, at_line(path, line.number, label.error().message));
    labels.push_back(std::move(*label));
  }
  std::ranges::stable_sort(labels, {}, &TimedLabel::time);
  return labels;
}

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
