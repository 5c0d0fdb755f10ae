// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/stage.h"

#include <array>
#include <cstddef>

namespace cairn {

const char* to_string(Stage stage) {
  constexpr std::array<const char*, static_cast<size_t>(Stage::kCount)> kNames = {
      "pyramid", "corners", "prior", "project", "coarse", "fine", "pose", "trails", "recover", "describe"};
  return kNames[static_cast<size_t>(stage)];
}

}  // namespace cairn
