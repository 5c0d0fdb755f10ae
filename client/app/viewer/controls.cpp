// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/controls.h"

#include <algorithm>
#include <array>
#include <utility>

#include "client/app/label_painter.h"
#include "client/app/label_view.h"
#include "client/session/label_request.h"

namespace cairn {
namespace {

constexpr std::chrono::seconds kMessageTime{4};
constexpr int kStopKey = 0xffc9;  // X11's F12: no letter of a label, and no program's own key

}  // namespace

std::vector<std::string> ViewerControls::help() {
  return {"click or touch a place   put a label there; on a label: select it",
          "e   change the text of the selected label",
          "d   delete the selected label",
          "n   new map",
          "f   freeze the view, and go on",
          "p   show points, and hide them",
          "o   another camera of the wearer, the next one, and back",
          "space   of a rig: emergency stop, F12 also while a label is typed; c clears it, and faults",
          "a w l t s   of a rig: ahead, with the wearer, lock, fixate the middle, search",
          "h   this help",
          "q   quit"};
}

void ViewerControls::show(OverlayFrame frame) {
  (frozen_ && frame_ ? missed_ : frame_) = std::move(frame);
}

void ViewerControls::show_others(std::vector<std::string> cameras, OtherView view) {
  cameras_ = std::move(cameras);
  if (view.camera != wanted_) return;  // it was asked for just now
  if (!frozen_ || view.camera != other_.camera) other_ = std::move(view);
}

void ViewerControls::press(int key_code, MonotonicTime now) {
  if (key_code == kStopKey && options_.has_rig) {
    (void)command_rig(' ', now);
  } else if (typing_) {
    if (const auto stroke = stroke_of(key_code)) type(*stroke, now);
  } else if (key_code == 0x1b || key_code == 0xff1b) {
    selected_ = {};
    help_shown_ = false;
  } else if (key_code >= 0x20 && key_code < 0x7f) {
    command(static_cast<char>(key_code), now);
  }
}

/// Carries out a key of the rig. Whether it is one.
bool ViewerControls::command_rig(char key, MonotonicTime now) {
  struct Key {
    char key;
    RigKey wish;
    const char* words;
  };
  constexpr std::array keys = {Key{' ', RigKey::kStop, "rig: emergency stop"},
                               Key{'c', RigKey::kClear, "rig: cleared; a mode begins anew"},
                               Key{'a', RigKey::kNeutral, "rig: ahead"},
                               Key{'w', RigKey::kFollow, "rig: with the wearer"},
                               Key{'l', RigKey::kLock, "rig: locked where it looks"},
                               Key{'t', RigKey::kFixate, "rig: the point in the middle"},
                               Key{'s', RigKey::kSearch, "rig: search"}};
  const auto* found = std::find_if(keys.begin(), keys.end(), [key](const Key& k) { return k.key == key; });
  if (!options_.has_rig || found == keys.end()) return false;
  wishes_.rig = found->wish;
  say(found->words, now);
  return true;
}

void ViewerControls::command(char key, MonotonicTime now) {
  if (command_rig(key, now)) return;
  switch (key) {
    case 'e':
      return edit_selected(now);
    case 'd':
      return delete_selected(now);
    case 'n':
      wishes_.new_map = true;
      return say(options_.may_make_maps ? "new map: move the camera sideways" : "looking for a map", now);
    case 'f':
      if (frozen_) return go_on();
      frozen_ = true;
      return;
    case 'o':
      return switch_camera(now);
    case 'p':
      points_shown_ = !points_shown_;
      return;
    case 'h':
      help_shown_ = !help_shown_;
      return;
    case 'q':
      wishes_.quit = true;
      return;
    default:
      return say("h shows the keys", now);
  }
}

/// Ends a frozen view: the newest frame is shown.
void ViewerControls::go_on() {
  frozen_ = false;
  if (missed_) frame_ = std::exchange(missed_, std::nullopt);
}

/// Shows the wearer's next camera in the order of names, and after the last of them this one.
void ViewerControls::switch_camera(MonotonicTime now) {
  go_on();
  const auto next = std::upper_bound(cameras_.begin(), cameras_.end(), wanted_);
  if (next != cameras_.end()) {
    wanted_ = *next;
    other_ = {};
    other_.camera = wanted_;
    other_.is_there = true;
    const auto place = next - cameras_.begin() + 1;
    return say(wanted_ +
                   (cameras_.size() > 1
                        ? ", camera " + std::to_string(place) + " of " + std::to_string(cameras_.size())
                        : "") +
                   ": o goes on",
               now);
  }
  const bool was_other = !std::exchange(wanted_, {}).empty();
  other_ = {};
  if (was_other) return say("this camera", now);
  say(options_.wearer.empty() ? "no other camera: pass --wearer NAME to this tracker and to the other's"
                              : "no other camera of wearer " + options_.wearer + " on this host",
      now);
}

void ViewerControls::touch(cv::Point point, cv::Size image, int scale, MonotonicTime now) {
  if (typing_) {
    const auto keys = lay_out_keyboard(image, typing_->entry.shifted());
    if (const auto stroke = stroke_at(keys, point)) type(*stroke, now);
    return;
  }
  if (std::exchange(help_shown_, false) || !frame_) return;
  if (!wanted_.empty())
    return say("the image of " + wanted_ + ": labels are put in this camera's, o goes on", now);
  const cv::Size area(camera_->width() * scale, camera_->height() * scale);
  if (!cv::Rect({0, 0}, area).contains(point)) return;
  const auto boxes = lay_out_labels(labels_in_view(*frame_, camera()), area, scale, painter_);
  if (const LabelBox* label = find_label(boxes, point)) {
    selected_ = {frame_->map, label->shown.label.id};
    return say(label->shown.label.text + ", by " + label->shown.label.author, now);
  }
  selected_ = {};
  point_at({(point.x + 0.5) / scale - 0.5, (point.y + 0.5) / scale - 0.5}, now);
}

void ViewerControls::point_at(const Eigen::Vector2d& pixel, MonotonicTime now) {
  if (!options_.may_label) return say("a reader places no labels", now);
  if (!frame_->camera_from_map || !frame_->snapshot) return say("no map here: no place for a label", now);
  const SE3& camera_from_map = *frame_->camera_from_map;
  const auto place =
      pick_place(pixel, camera(), seen_points(frame_->points, *frame_->snapshot, camera_from_map));
  if (!place) return say("the map has no points there", now);
  auto request =
      request_new_label(*frame_->snapshot, camera_from_map, camera_from_map.inverse() * *place, {});
  if (request) typing_ = Typing{std::move(*request), TextEntry()};
}

void ViewerControls::type(EntryStroke stroke, MonotonicTime now) {
  TextEntry& entry = typing_->entry;
  entry.press(stroke);
  if (entry.state() == TextEntry::State::kTyping) return;
  if (entry.state() == TextEntry::State::kAccepted) {
    typing_->request.text = entry.text();
    wishes_.requests.push_back(std::move(typing_->request));
    say("sent: " + entry.text(), now);
  }
  typing_.reset();
}

const Label* ViewerControls::selected_label() const {
  if (!frame_ || !frame_->labels || frame_->map != selected_.map) return nullptr;
  const auto found = std::find_if(frame_->labels->begin(), frame_->labels->end(),
                                  [this](const Label& label) { return label.id == selected_.id; });
  return found == frame_->labels->end() ? nullptr : &*found;
}

void ViewerControls::delete_selected(MonotonicTime now) {
  if (!options_.may_label) return say("a reader deletes no labels", now);
  if (selected_label() == nullptr) return say("click a label first", now);
  wishes_.requests.push_back(request_label_removal(selected_.map, selected_.id));
  selected_ = {};
}

void ViewerControls::edit_selected(MonotonicTime now) {
  if (!options_.may_label) return say("a reader changes no labels", now);
  const Label* label = selected_label();
  if (label == nullptr) return say("click a label first", now);
  typing_ = Typing{request_label_text(selected_.map, selected_.id, {}), TextEntry(label->text)};
}

void ViewerControls::replied(const RequestReply& reply, MonotonicTime now) {
  say(reply.done ? "kept" : "refused: " + reply.reason, now);
}

void ViewerControls::say(std::string message, MonotonicTime now) {
  message_ = std::move(message);
  said_at_ = now;
}

std::string ViewerControls::message(MonotonicTime now) const {
  return now - said_at_ < kMessageTime ? message_ : std::string();
}

}  // namespace cairn
