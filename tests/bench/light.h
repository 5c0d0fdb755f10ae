// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>

#include "common/image/image.h"

/// An image as it would be in other light or under another exposure.
namespace cairn {

/// v -> 255 (v / 255)^gamma * gain + bias, rounded and clipped to 0..255.
struct Light {
  double gain = 1;
  double bias = 0;   ///< [grey levels]
  double gamma = 1;  ///< > 1: darker
};
[[nodiscard]] std::string to_string(const Light& light);

/// Light as recorded, and each change under which a place must be found again, alone: gain 0.5 and 2, bias
/// -40 and +40, gamma 0.5 and 2.
[[nodiscard]] std::span<const Light> lights_to_stand();

[[nodiscard]] std::array<uint8_t, 256> light_table(const Light& light);
[[nodiscard]] GrayImage relight(const GrayImage& image, const Light& light);

}  // namespace cairn
