// SPDX-License-Identifier: Apache-2.0
#include "tests/world/scenario.h"

#include <array>

#include "tests/world/bays.h"
#include "tests/world/building.h"
#include "tests/world/columns.h"
#include "tests/world/desk.h"
#include "tests/world/hold.h"
#include "tests/world/laboratory.h"
#include "tests/world/office.h"
#include "tests/world/shoulder.h"

namespace cairn {
namespace {

struct Recipe {
  ScenarioInfo info;
  Scenario (*make)(const ScenarioOptions& options);
};

constexpr std::array<Recipe, 15> kRecipes = {
    {{{"desk",
       "a 1.6 m desk with monitors, books, print, mugs and cables before a blank wall; a round trip of 55 s"},
      make_desk},
     {{"desk-moved", "the desk of the same seed, whose stack of books and a mug have been moved"},
      make_desk_moved},
     {{"desks",
       "an office of 15 look-alike curved desks, two of them nearly empty; 12 are mapped, then all visited"},
      make_office},
     {{"laboratory",
       "a room and a robot in it, both mapped, then visited in turn; the robot is moved half-way"},
      make_laboratory},
     {{"building",
       "five places on three floors, one of them nearly empty; mapped, then visited in another order"},
      make_building},
     {{"pan", "turns of 90 degrees away from a mapped desk, to a bookcase, and back, at 60 to 150 degrees/s"},
      make_pan},
     {{"roll", "turns of 60 degrees to either side about the optical axis before a mapped desk"}, make_roll},
     {{"look-away", "from a mapped desk to a blank wall and back"}, make_look_away},
     {{"watermark", "look-away with a still water mark over the image"}, make_watermark},
     {{"border", "the desk through the round image of an endoscope, with turns"}, make_border},
     {{"rush", "the desk; `speed` is that of the hand after 8 calm seconds"}, make_rush},
     {{"outage", "from a desk along the walls of its room, always to what is new"}, make_outage},
     {{"bays", "forward along a footbridge of equal bays at night"}, make_bays},
     {{"columns",
       "round a temple of equal columns before black; with speed=6&frames=48 stills 7.5 degrees apart"},
      make_columns},
     {{"shoulder", "round a stand in the middle of a room, for the camera of a simulated rig"},
      make_shoulder}}};

}  // namespace

SE3 Body::at(double route_seconds) const {
  SE3 pose = map_from_body;
  for (const Glide& glide : glides) {
    const double eased = minimum_jerk((route_seconds - glide.begin) / (glide.end - glide.begin));
    pose = SE3(pose.rotation().slerp(eased, glide.map_from_body.rotation()),
               pose.translation() + eased * (glide.map_from_body.translation() - pose.translation()));
  }
  return pose;
}

std::string_view to_string(PhaseKind kind) {
  switch (kind) {
    case PhaseKind::kMap:
      return "map";
    case PhaseKind::kWalk:
      return "walk";
    case PhaseKind::kVisit:
      return "visit";
  }
  return "";
}

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
  static const std::vector<ScenarioInfo> scenarios = [] {
    std::vector<ScenarioInfo> list;
    for (const Recipe& recipe : kRecipes) list.push_back(recipe.info);
    return list;
  }();
  return scenarios;
}

Result<Scenario> make_scenario(std::string_view name, const ScenarioOptions& options) {
  for (const Recipe& recipe : kRecipes) {
    if (recipe.info.name == name) return recipe.make(options);
  }
  std::string message = "scenario '";
  message.append(name).append("': unknown; there are:");
  for (const Recipe& recipe : kRecipes) message.append(" ").append(recipe.info.name);
  return fail(ErrorCode::kUsage, message);
}

}  // namespace cairn
