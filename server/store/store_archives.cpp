// SPDX-License-Identifier: Apache-2.0
#include "server/store/database_files.h"
#include "server/store/entry_codec.h"
#include "server/store/proposal_codec.h"
#include "server/store/store.h"

/// Maps that leave a store as archives, come into it from one, or from another of its maps.
namespace cairn {
namespace {

namespace fs = std::filesystem;

/// Latest epoch of an archive [ms, as start_count()]: the year 71 000. What follows it must be a number, too.
constexpr uint64_t kLatestEpoch = uint64_t{1} << 51;

/// The message without the name of the file that it is about.
std::string without_path(std::string message, const fs::path& path) {
  const std::string name = path.string() + ": ";
  for (size_t at = message.find(name); at != std::string::npos; at = message.find(name, at))
    message.erase(at, name.size());
  return message;
}

}  // namespace

Status Store::export_map(MapId map, const fs::path& path) const {
  auto file = MapFile::open(path_of(map));
  if (!file) return tl::unexpected(file.error());
  if (Status copied = file->copy_to(path); !copied) return copied;
  auto copy = MapFile::open(path);
  return copy ? copy->erase_proposals() : tl::unexpected(copy.error());
}

Status Store::copy_map(MapId map, MapId copy, const std::string& name) const {
  auto file = MapFile::open(path_of(map));
  if (!file) return tl::unexpected(file.error());
  const auto as_of_now = file->read_as_of_now();
  if (!as_of_now) return tl::unexpected(as_of_now.error());
  StoredMap read = file->load(LoadedImages::kNone);
  if (!read.damage.empty()) return fail(ErrorCode::kDamaged, read.damage.front());
  MapHeader header = read.header;
  header.id = copy;
  header.name = name;
  return make(header, {std::move(read.record), {}, std::move(read.labels), {}, std::move(read.contributions)},
              &*file);
}

Result<MapId> Store::import_map(const fs::path& archive, uint64_t most_image_bytes) const {
  const fs::path copy = folder_ / "incoming";
  Status copied = remove_database(copy);
  if (copied) copied = copy_bytes(archive, copy);
  if (!copied) {
    discard_database(copy);
    return fail(ErrorCode::kIo, "it cannot be copied into the store: " + copied.error().message +
                                    "; free space there, or see to owner and mount");
  }
  Result<MapId> taken = fail(ErrorCode::kInternal, "not opened");
  {
    auto file = MapFile::open(copy, FileOrigin::kElsewhere);
    taken = file ? take_in(&*file, most_image_bytes) : tl::unexpected(file.error());
  }
  discard_database(copy);
  if (!taken) return fail(taken.error().code, without_path(taken.error().message, copy));
  return taken;
}

Result<MapId> Store::take_in(MapFile* archive, uint64_t most_image_bytes) const {
  StoredMap read = archive->load(LoadedImages::kNone);
  if (!read.damage.empty()) return fail(ErrorCode::kDamaged, read.damage.front());
  if (Status sound = archive->check_images(most_image_bytes); !sound) return tl::unexpected(sound.error());
  const MapId map = read.header.id;
  if (read.header.epoch.value > kLatestEpoch)
    return fail(ErrorCode::kDamaged, "its epoch, " + std::to_string(read.header.epoch.value) +
                                         ", is none that a server has given");
  if (const Status is_free = check_is_free(read.header); !is_free) return tl::unexpected(is_free.error());
  // Clients of the same names here are others, with other cameras and sessions.
  for (CalibratedCameraRecord& found : read.record.calibrated_cameras) found.camera.version.client = {};
  MapUpdate whole{std::move(read.record), {}, std::move(read.labels), {}, std::move(read.contributions)};
  // One that leaves no room for those to come was given by nobody.
  if (read.last_proposal <= kMostProposalNumber / 2) whole.last_proposal = read.last_proposal;
  if (Status made = make(read.header, whole, archive); !made) return tl::unexpected(made.error());
  return map;
}

Result<StoredMap> read_archive(const fs::path& path) {
  auto file = MapFile::open(path, FileOrigin::kElsewhere);
  if (!file) return tl::unexpected(file.error());
  return file->load();
}

}  // namespace cairn
