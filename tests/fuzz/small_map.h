// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/store/entry_codec.h"
#include "server/store/row_codec.h"

/// A map of two keyframes and a few points, to make seeds of.
namespace cairn::fuzz {

[[nodiscard]] CameraPtr small_camera();
[[nodiscard]] GrayImage small_image();
[[nodiscard]] MapHeader small_header();
[[nodiscard]] MapRecord small_record();
[[nodiscard]] LabelRecord small_label();
[[nodiscard]] DecisionRecord small_decision();

}  // namespace cairn::fuzz
