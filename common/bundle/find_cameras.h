// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "common/bundle/bundle.h"

namespace cairn {

/// solve_bundle() for a problem with free cameras of which little may be known. As long as a focal length is
/// not known to a few percent the minimization starts from several, the rest of the problem stretched along
/// the first camera's axis to go with each; the least cost wins. The covariances take in how far the estimate
/// would move without one part of the motion or another (jackknife over runs of keyframes), for residuals are
/// not independent, and what the values taken for given, principal point and k2, may have done (Schmidt 1966:
/// consider covariance): the formal covariance alone promises ten times too much. Equal inputs give equal
/// bytes.
BundleReport find_cameras(BundleProblem* problem, const BundleOptions& options);

}  // namespace cairn
