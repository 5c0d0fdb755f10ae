// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>

namespace cairn {

/// Where the running program's own file lies, links followed; empty if the system does not tell. What belongs
/// to it is found from there, in the build tree as where it was installed.
[[nodiscard]] std::filesystem::path program_folder();

}  // namespace cairn
