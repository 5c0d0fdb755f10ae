// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/viewer.h"

#include <chrono>
#include <exception>
#include <opencv2/highgui.hpp>
#include <utility>

#include "client/app/overlay.h"
#include "client/app/viewer/painter.h"

namespace cairn {
namespace {

constexpr int kPollMs = 20;  ///< for keys and touches, and so the least time between two images

}  // namespace

/// All that belongs to the window's thread.
struct Viewer::Window {
  Window(CameraPtr camera, std::string name, ViewerOptions options)
      : title(std::move(name)), overlay(camera), controls(std::move(camera), options) {
    cv::namedWindow(title, cv::WINDOW_AUTOSIZE | cv::WINDOW_GUI_NORMAL);
    cv::setMouseCallback(title, &Window::on_mouse, this);
  }
  ~Window() {
    try {
      cv::destroyWindow(title);
    } catch (const cv::Exception&) {  // it is closed already
    }
  }
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;

  static void on_mouse(int event, int x, int y, int /*flags*/, void* window) {
    auto* self = static_cast<Window*>(window);
    if (event == cv::EVENT_LBUTTONDOWN)
      self->controls.touch({x, y}, self->overlay.size(), self->overlay.scale(),
                           std::chrono::steady_clock::now());
    if (event == cv::EVENT_LBUTTONDOWN) self->changed = true;
  }
  [[nodiscard]] bool is_open() const { return cv::getWindowProperty(title, cv::WND_PROP_VISIBLE) >= 1; }

  /// If anything is different from the image in the window.
  void draw(MonotonicTime now) {
    const OtherView& other = controls.other();
    std::string word = controls.message(now) + (other.camera.empty() ? "" : describe(other));
    if (!controls.frame() || (!changed && word == word_drawn)) return;
    changed = false;
    word_drawn = std::move(word);
    overlay.draw(*controls.frame(), {controls.points_shown(), controls.selected()}).copyTo(image);
    if (!other.camera.empty()) {
      const OverlayFrame& frame = *controls.frame();
      const cv::Size area(frame.image->width() * overlay.scale(), frame.image->height() * overlay.scale());
      paint_other(other, {{}, area}, painter, &image);
    }
    paint_controls(controls, now, painter, &image);
    cv::imshow(title, image);
  }

  std::string title;
  Overlay overlay;
  ViewerControls controls;
  TextPainter painter;
  cv::Mat image;
  bool changed = false;
  std::string word_drawn;
};

Viewer::Viewer(CameraPtr camera, const std::string& title, ViewerOptions options, ViewerLink link, Logger log)
    : camera_(std::move(camera)),
      title_(title),
      link_(std::move(link)),
      options_(options),
      log_(std::move(log)),
      thread_([this] { run(); }) {}

Viewer::~Viewer() {
  stopping_ = true;
  thread_.join();
}

void Viewer::on_frame(const FrameReport& report) {
  OverlayFrame frame = make_overlay_frame(report);
  const std::scoped_lock lock(mutex_);
  newest_ = std::move(frame);
}

void Viewer::run() {
  try {
    Window window(camera_, title_, options_);
    while (!stopping_ && !quit_) serve(&window);
  } catch (const std::exception& problem) {
    log_->warn("the window is lost, going on without: {}", problem.what());
  }
}

void Viewer::serve(Window* window) {
  std::optional<OverlayFrame> frame;
  {
    const std::scoped_lock lock(mutex_);
    frame = std::exchange(newest_, std::nullopt);
  }
  ViewerControls& controls = window->controls;
  if (frame) {
    controls.show(std::move(*frame));
    window->changed = true;
  }
  // A frozen view shows labels that come, too.
  if (controls.frame() && controls.frame()->map && controls.set_labels(link_.labels(controls.frame()->map)))
    window->changed = true;
  const auto* shown = controls.other().pixels.data;
  link_.choose_camera(controls.wanted());
  controls.show_others(link_.cameras(), link_.other());
  if (controls.other().pixels.data != shown) window->changed = true;
  const MonotonicTime now = std::chrono::steady_clock::now();
  for (const RequestReply& reply : link_.take_replies()) controls.replied(reply, now);
  window->draw(now);
  const int key = cv::waitKeyEx(kPollMs);
  if (key >= 0) {
    controls.press(key, now);
    window->changed = true;
  }
  if (!window->is_open()) quit_ = true;
  carry_out(controls.take_wishes());
}

void Viewer::carry_out(ViewerWishes wishes) {
  for (wire::ClientRequest& request : wishes.requests) link_.request(std::move(request));
  if (wishes.rig) link_.rig(*wishes.rig);
  if (wishes.new_map) new_map_ = true;
  if (wishes.quit) quit_ = true;
}

}  // namespace cairn
