// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/base/time.h"
#include "common/geometry/se3.h"
#include "common/map/ids.h"

namespace cairn {

inline constexpr size_t kMaxLabelBytes = 256;              ///< of its text
inline constexpr size_t kMaxAuthorBytes = kMaxNameLength;  ///< of who made it
inline constexpr size_t kMaxLabels = 1000;                 ///< of a map

enum class LabelKind : uint8_t {
  kText = 0,
  kModel = 1,  ///< the text is where a glTF model lies (a URI); it is drawn by who can
  kLast = kModel,
};

/// A text that somebody has put at a place of a map.
struct Label {
  LabelId id;
  LabelKind kind = LabelKind::kText;
  std::string text;
  /// Its origin is the place. The axes of a label that was pointed at are those of the camera that did: x
  /// right, y down, z away from the viewer.
  SE3 map_from_label;
  std::string author;  ///< name of the client or operator
  Timestamp time;      ///< of its last change by a person
};

/// Ascending by id.
using LabelListPtr = std::shared_ptr<const std::vector<Label>>;

}  // namespace cairn
