// SPDX-License-Identifier: Apache-2.0
#include "tests/world/labels.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <iomanip>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "common/image/corners.h"
#include "common/io/text.h"

namespace cairn {
namespace {

constexpr const char* kLabelsFile = "labels.txt";
constexpr const char* kTruthFile = "label_truth.txt";
constexpr double kPartOfPhase = 0.75;
constexpr int kFastThreshold = 15;
constexpr int kBorder = 40;  // px
/// Distance in the image within which something may be taken for what is pointed at.
constexpr int kSurroundings = 14;     // px
constexpr double kOneSurface = 0.04;  // of the depth

/// Whether all around the pixel is of the same place, at about the same depth.
bool is_on_surface(const Simulator& simulator, int frame, const Eigen::Vector2d& pixel,
                   const SimThing& thing) {
  for (const int dx : {-kSurroundings, 0, kSurroundings}) {
    for (const int dy : {-kSurroundings, 0, kSurroundings}) {
      const auto near = simulator.thing_at(frame, pixel + Eigen::Vector2d(dx, dy));
      if (!near || near->place != thing.place) return false;
      if (std::abs(near->depth - thing.depth) > kOneSurface * thing.depth) return false;
    }
  }
  return true;
}

/// The stronger half of an image's corners, from the middle of the image outwards.
std::vector<Eigen::Vector2i> strong_corners(const GrayImage& image) {
  CornerList corners;
  detect_fast10(image.view(), kFastThreshold, &corners);
  auto candidates = find_candidates(image.view(), corners, kFastThreshold, kBorder);
  std::ranges::stable_sort(candidates, std::greater{}, &Candidate::score);
  candidates.resize((candidates.size() + 1) / 2);
  std::vector<Eigen::Vector2i> pixels;
  for (const Candidate& candidate : candidates) pixels.emplace_back(candidate.corner.x, candidate.corner.y);
  const Eigen::Vector2i middle(image.width() / 2, image.height() / 2);
  std::ranges::stable_sort(pixels, {}, [&](const Eigen::Vector2i& p) { return (p - middle).squaredNorm(); });
  return pixels;
}

std::optional<LabelTarget> choose_in_frame(Simulator* simulator, int frame, int place) {
  const SimFrame shown = simulator->frame(frame);
  for (const Eigen::Vector2i& corner : strong_corners(shown.image)) {
    const Eigen::Vector2d pixel = corner.cast<double>();
    const auto thing = simulator->thing_at(frame, pixel);
    if (!thing || thing->place != place || !is_on_surface(*simulator, frame, pixel, *thing)) continue;
    const std::string& name = simulator->places()[static_cast<size_t>(place)].name;
    return LabelTarget{{name, thing->in_place}, shown.time, corner};
  }
  return std::nullopt;
}

Result<std::ofstream> open_file(const std::filesystem::path& path) {
  std::ofstream file(path);
  if (!file) return fail(ErrorCode::kIo, path.string() + ": cannot be written");
  return file;
}

}  // namespace

std::vector<LabelTarget> choose_label_targets(Simulator* simulator) {
  std::vector<LabelTarget> targets;
  std::set<int> labelled;
  for (const Phase& phase : simulator->phases()) {
    if (phase.kind != PhaseKind::kMap || !labelled.insert(phase.place).second) continue;
    const int begin = static_cast<int>(phase.begin * kSimulatorFrameRate);
    const int end = std::min(static_cast<int>(phase.end * kSimulatorFrameRate), simulator->frame_count());
    std::optional<LabelTarget> target;
    for (int i = begin + static_cast<int>(kPartOfPhase * (end - begin)); i < end && !target; ++i)
      target = choose_in_frame(simulator, i, phase.place);
    if (target) targets.push_back(std::move(*target));
  }
  return targets;
}

Status write_label_targets(const std::filesystem::path& directory, const std::vector<LabelTarget>& targets) {
  auto labels = open_file(directory / kLabelsFile);
  if (!labels) return tl::unexpected(labels.error());
  auto truth = open_file(directory / kTruthFile);
  if (!truth) return tl::unexpected(truth.error());
  *labels << "# timestamp x y text: a label to be placed at a pixel of the frame of that time\n";
  *truth << "# place x y z: what the label of the place's name is to be at, in the place's frame\n"
         << std::fixed << std::setprecision(9);
  for (const auto& [thing, time, pixel] : targets) {
    *labels << format_timestamp(time) << ' ' << pixel.x() << ' ' << pixel.y() << ' ' << thing.place << '\n';
    *truth << thing.place << ' ' << thing.point.x() << ' ' << thing.point.y() << ' ' << thing.point.z()
           << '\n';
  }
  if (!labels->flush() || !truth->flush())
    return fail(ErrorCode::kIo, directory.string() + ": write failed (disk full?)");
  return {};
}

Result<std::vector<LabelTruth>> read_label_truth(const std::filesystem::path& directory) {
  const std::filesystem::path path = directory / kTruthFile;
  const auto content = read_text_file(path);
  if (!content) return tl::unexpected(content.error());
  std::vector<LabelTruth> things;
  for (const TextLine& line : table_rows(*content)) {
    const auto fields = split_fields(line.text);
    std::array<std::optional<double>, 3> at;
    for (size_t i = 0; i < at.size() && fields.size() == 4; ++i) at[i] = parse_number(fields[i + 1]);
    if (!at[0] || !at[1] || !at[2])
      return fail(ErrorCode::kDamaged, at_line(path, line.number, "expected `place x y z`"));
    things.push_back({std::string(fields[0]), {*at[0], *at[1], *at[2]}});
  }
  return things;
}

Result<std::vector<PlacedLabel>> read_placed_labels(const std::filesystem::path& path) {
  const auto content = read_text_file(path);
  if (!content) return tl::unexpected(content.error());
  try {
    std::vector<PlacedLabel> labels;
    for (const auto& label : nlohmann::json::parse(*content)) {
      const auto at = label.at("position").get<std::array<double, 3>>();
      labels.push_back({label.at("map").get<std::string>(), label.at("text").get<std::string>(),
                        Eigen::Vector3d(at[0], at[1], at[2])});
    }
    return labels;
  } catch (const nlohmann::json::exception& problem) {
    return fail(ErrorCode::kDamaged,
                path.string() + ": not what `cairnctl --json labels` says: " + problem.what());
  }
}

}  // namespace cairn
