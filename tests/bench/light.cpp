// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/light.h"

#include <fmt/format.h>
#include <algorithm>
#include <cmath>

namespace cairn {

std::string to_string(const Light& light) {
  if (light.gain != 1) return fmt::format("gain {:g}", light.gain);
  if (light.bias != 0) return fmt::format("bias {:+g}", light.bias);
  if (light.gamma != 1) return fmt::format("gamma {:g}", light.gamma);
  return "as recorded";
}

std::span<const Light> lights_to_stand() {
  static constexpr std::array<Light, 7> kLights = {
      {{}, {.gain = 0.5}, {.gain = 2}, {.bias = -40}, {.bias = 40}, {.gamma = 0.5}, {.gamma = 2}}};
  return kLights;
}

std::array<uint8_t, 256> light_table(const Light& light) {
  std::array<uint8_t, 256> table{};
  for (size_t v = 0; v < table.size(); ++v) {
    const double curved = 255 * std::pow(static_cast<double>(v) / 255, light.gamma);
    table[v] = static_cast<uint8_t>(std::clamp(std::lround(light.gain * curved + light.bias), 0L, 255L));
  }
  return table;
}

GrayImage relight(const GrayImage& image, const Light& light) {
  const auto table = light_table(light);
  GrayImage lit(image.width(), image.height());
  for (int y = 0; y < image.height(); ++y) {
    std::transform(image.row(y), image.row(y) + image.width(), lit.row(y),
                   [&](uint8_t v) { return table[v]; });
  }
  return lit;
}

}  // namespace cairn
