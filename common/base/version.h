// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace cairn {

/// The version of this build: the project's and, from a git checkout, the commit, with `.dirty` where tracked
/// files differ from it: "0.1.0+g1a2b3c4d.dirty".
std::string_view version();

}  // namespace cairn
