// SPDX-License-Identifier: Apache-2.0
#include "common/base/program_folder.h"

namespace cairn {

std::filesystem::path program_folder() {
  std::error_code error;
  return std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
}

}  // namespace cairn
