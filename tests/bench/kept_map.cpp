// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/kept_map.h"

#include <utility>

#include "server/mapping/map_maker.h"
#include "server/store/map_file.h"

namespace cairn {
namespace {

std::filesystem::path map_path(const std::filesystem::path& folder, const std::string& name) {
  return folder / (name + ".cairn");
}

std::filesystem::path poses_path(const std::filesystem::path& folder, const std::string& name) {
  return folder / (name + ".txt");
}

}  // namespace

Status keep_map(const std::filesystem::path& folder, const std::string& name, const MapId& map,
                const MapRecord& record, const std::vector<StampedPose>& poses) {
  std::error_code ignored;  // of what cannot be made or removed the next step tells
  std::filesystem::create_directories(folder, ignored);
  std::filesystem::remove(map_path(folder, name), ignored);
  auto writer = TrajectoryWriter::open(poses_path(folder, name));
  if (!writer) return tl::unexpected(writer.error());
  for (const StampedPose& p : poses) {
    if (Status done = writer->append(map, name, p); !done) return done;
  }
  if (Status done = writer->finish(); !done) return done;
  const MapHeader header{map, name, Epoch{1}, false, {}};
  const auto file = MapFile::create(map_path(folder, name), header, {record, {}, {}, {}});
  if (!file) return tl::unexpected(file.error());
  return {};
}

Result<KeptMap> read_kept_map(const std::filesystem::path& folder, const std::string& name,
                              const MapId& map) {
  auto file = MapFile::open(map_path(folder, name));
  if (!file) return tl::unexpected(file.error());
  const StoredMap stored = file->load();
  auto restored = MapMaker::restore(stored.record, {map, name, Epoch{1}}, MapMakerOptions{});
  if (!restored) return tl::unexpected(restored.error());
  auto trajectory = read_trajectory(poses_path(folder, name));
  if (!trajectory) return tl::unexpected(trajectory.error());
  KeptMap kept;
  const MapSnapshotPtr snapshot = restored->maker->snapshot();
  kept.map = index_map(nullptr, snapshot, restored->maker->keyframe_views(), GravityOptions());
  for (TrajectorySegment& segment : trajectory->segments)
    std::move(segment.poses.begin(), segment.poses.end(), std::back_inserter(kept.poses));
  return kept;
}

}  // namespace cairn
