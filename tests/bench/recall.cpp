// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/recall.h"

#include <algorithm>
#include <cmath>

namespace cairn {
namespace {

constexpr double kSameDirection = 20 * M_PI / 180;

}  // namespace

bool overlaps_a_view(const SE3& view, std::span<const SE3> mapped, double distance) {
  const double cosine = std::cos(kSameDirection);
  const Eigen::Vector3d axis = view.rotation_matrix().col(2);
  return std::any_of(mapped.begin(), mapped.end(), [&](const SE3& other) {
    return (other.translation() - view.translation()).norm() <= distance &&
           other.rotation_matrix().col(2).dot(axis) >= cosine;
  });
}

bool is_right_pose(const Judged& judged) {
  return !judged.off || judged.off->is_right(judged.tolerance * judged.depth);
}

void Recall::add(const Judged& judged) {
  ++(judged.in_view ? in_view : elsewhere);
  if (!judged.answered) return;
  answered_else += judged.in_view ? 0 : 1;
  wrong_map += judged.right_map ? 0 : 1;
  if (!judged.right_map) return;
  if (judged.off && judged.depth > 0) off.push_back(judged.off->metres / judged.depth);
  if (!is_right_pose(judged)) {
    ++wrong_pose;
  } else if (judged.in_view) {
    ++right;
  }
}

void Recall::add(const Recall& other) {
  in_view += other.in_view;
  right += other.right;
  elsewhere += other.elsewhere;
  answered_else += other.answered_else;
  wrong_map += other.wrong_map;
  wrong_pose += other.wrong_pose;
  off.insert(off.end(), other.off.begin(), other.off.end());
}

}  // namespace cairn
