// SPDX-License-Identifier: Apache-2.0
#include "tests/world/scenario.h"

#include "tests/world/desk.h"

namespace cairn {

Face make_face(const Eigen::Vector3d& origin, const Eigen::Vector3d& right, const Eigen::Vector3d& up,
               const TextureRegion& region, float brightness) {
  Face face;
  face.corners = {origin, origin + right, origin + right + up, origin + up};
  face.normal = right.cross(up).normalized();
  face.texture = region.texture;
  face.brightness = brightness;
  // The axes dual to (right, up) within the plane, so that a skewed parallelogram is covered too.
  const Eigen::Vector3d right_dual = up.cross(face.normal) / right.dot(up.cross(face.normal));
  const Eigen::Vector3d up_dual = face.normal.cross(right) / up.dot(face.normal.cross(right));
  face.u_axis = region.width * right_dual;
  face.u_offset = region.x0 - face.u_axis.dot(origin);
  face.v_axis = -region.height * up_dual;
  face.v_offset = region.y0 + region.height - face.v_axis.dot(origin);
  return face;
}

const std::vector<ScenarioInfo>& scenario_list() {
  static const std::vector<ScenarioInfo> scenarios = {{"desk",
                                                       "a 1.6 m desk with monitors, books, print, mugs and "
                                                       "cables before a blank wall; a round trip of 55 s"}};
  return scenarios;
}

Result<Scenario> make_scenario(std::string_view name, uint64_t seed) {
  if (name == "desk") return make_desk(seed);
  std::string message = "scenario '";
  message.append(name).append("': unknown; there are:");
  for (const ScenarioInfo& info : scenario_list()) message.append(" ").append(info.name);
  return fail(ErrorCode::kUsage, message);
}

}  // namespace cairn
