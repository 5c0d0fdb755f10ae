// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/display.h"

#include <X11/Xlib.h>

#include <cstdlib>

namespace cairn {

std::string why_no_window() {
  const char* name = std::getenv("DISPLAY");
  if (name == nullptr || *name == '\0') return "there is no display";
  Display* display = XOpenDisplay(nullptr);
  if (display == nullptr) return std::string("display ") + name + " cannot be reached";
  XCloseDisplay(display);
  return {};
}

}  // namespace cairn
