// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "common/base/result.h"
#include "common/bundle/bundle.h"

/// Bundle adjustment problems in files: our own dumps, and BAL.
namespace cairn {

/// Writes a problem as text, numbers exact: a line "cairn-bundle cameras poses points observations", then a
/// camera per line (model width height values...), pose (camera fixed tx ty tz qx qy qz qw), point (x y z),
/// observation (pose point u v inverse_sigma).
[[nodiscard]] Status write_bundle(const std::string& path, const BundleProblem& problem);

/// Reads such a file, or a BAL problem (Agarwal et al. 2010: "cameras points observations", then camera,
/// point and pixel per observation, then nine numbers a camera and three a point). BAL cameras look along -z
/// with y up: turned by half a turn about x. Their focal length and distortion stay as given, the first
/// camera is fixed.
[[nodiscard]] Result<BundleProblem> read_bundle(const std::string& path);

}  // namespace cairn
