// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace cairn {

/// Why there can be no window, for a person; empty: there can. To be asked before a window is made: without a
/// display, Qt ends the process.
[[nodiscard]] std::string why_no_window();

}  // namespace cairn
