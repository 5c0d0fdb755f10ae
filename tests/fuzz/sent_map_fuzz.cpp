// SPDX-License-Identifier: Apache-2.0
//
// A map from the rows of an archive to what its readers are sent: rows one after another (table, id, length
// of two bytes, row), which are put together as an import does. Whatever they say, what comes of them is let
// through by who receives it.
#include <optional>

#include "common/wire/internal/convert.h"
#include "server/mapping/snapshot_builder.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/small_map.h"

namespace cairn::fuzz {
namespace {

/// Of rows; the header is theirs that says how much there is.
enum Table : uint8_t {
  kCameras,
  kCalibratedCameras,
  kKeyframes,
  kImages,
  kMeasurements,
  kSources,
  kPositions,
  kFoundation,
  kLabels,
  kCounts,
  kTables
};
constexpr size_t kHeadBytes = 4;
constexpr size_t kMostKeyframes = 200;  ///< more take the fuzzer's time and tell nothing
constexpr size_t kMostPoints = 500;

struct Row {
  uint8_t table;
  uint8_t id;
  Bytes data;
};

std::optional<Row> take_row(Bytes* bytes) {
  if (bytes->size() < kHeadBytes) return std::nullopt;
  const size_t said = (*bytes)[2] | size_t{(*bytes)[3]} << 8;
  const size_t length = std::min(said, bytes->size() - kHeadBytes);
  const Row row{static_cast<uint8_t>((*bytes)[0] % kTables), (*bytes)[1], bytes->subspan(kHeadBytes, length)};
  *bytes = bytes->subspan(kHeadBytes + length);
  return row;
}

/// False: the row is unfit, and the archive with it.
class Import {
 public:
  [[nodiscard]] bool take(const Row& row) {
    const KeyframeId keyframe{row.id};
    switch (row.table) {
      case kCameras:
        return take_camera(row);
      case kCalibratedCameras:
        return keep(decode_calibrated_camera(row.id % kMaxCalibratedCameras, row.data, cameras_),
                    &record_.calibrated_cameras);
      case kKeyframes:
        return row.id > 0 && keep(decode_keyframe(keyframe, row.data, cameras_), &record_.keyframes);
      case kImages:
        return take_image(row);
      case kMeasurements:
        return keep(decode_measurements(keyframe, row.data), &record_.measurements);
      case kSources:
        return keep(decode_sources(row.id, row.data), &record_.sources);
      case kPositions:
        return keep(decode_positions(row.id, row.data), &record_.positions);
      case kFoundation:
        return (record_.foundation = decode_foundation(row.data)).has_value();
      case kLabels:
        return keep(decode_label(row.id, row.data), &labels_);
      default:
        return take_counts(row);
    }
  }

  [[nodiscard]] const MapRecord& record() const { return record_; }
  [[nodiscard]] const MapHeader& header() const { return header_; }
  [[nodiscard]] const std::vector<LabelRecord>& labels() const { return labels_; }

 private:
  template <typename Record>
  static bool keep(std::optional<Record> row, std::vector<Record>* rows) {
    if (row) rows->push_back(std::move(*row));
    return row.has_value();
  }
  bool take_camera(const Row& row) {
    const auto parameters = decode_camera(row.data);
    const auto camera = parameters ? make_camera(*parameters) : fail(ErrorCode::kDamaged, "no camera");
    if (!camera) return false;
    cameras_[row.id < 200 ? row.id : calibrated_camera_row(row.id - 200)] = *camera;
    return true;
  }
  bool take_image(const Row& row) {
    ImageRecord image{KeyframeId{row.id}, decode_image_row(row.data)};
    if (image.image == nullptr) return false;
    record_.images.push_back(std::move(image));
    return true;
  }
  bool take_counts(const Row& row) {
    const auto header = decode_header(row.data);
    if (!header || header->keyframes > kMostKeyframes || header->points > kMostPoints) return false;
    header_ = header->header;
    record_.keyframe_count = header->keyframes;
    record_.point_count = header->points;
    return true;
  }

  MapHeader header_;
  MapRecord record_;
  CameraRows cameras_;
  std::vector<LabelRecord> labels_;
};

template <typename Message>
void demand_sent(const Message& message) {
  wire::internal::Scratch scratch;
  const auto sample = wire::internal::encode(message, &scratch);
  const auto heard = wire::internal::decode<Message>(sample);
  demand(heard.has_value(),
         "what is imported can be sent: " + (heard ? std::string() : heard.error().message));
}

void put(Table table, size_t id, const Blob& row, Input* out) {
  out->push_back(table);
  out->push_back(static_cast<uint8_t>(id));
  out->push_back(static_cast<uint8_t>(row.size()));
  out->push_back(static_cast<uint8_t>(row.size() >> 8));
  out->insert(out->end(), row.begin(), row.end());
}

}  // namespace

void decode(Bytes bytes) {
  Import import;
  while (const auto row = take_row(&bytes)) {
    if (!import.take(*row)) return;
  }
  const auto map = assemble_map(import.record(), RestoredImages::kStay);
  if (!map) return;
  const MapHeader& header = import.header();
  SnapshotBuilder builder(header.id, header.name, header.epoch, PublicationOptions());
  const MapSnapshotPtr snapshot = builder.build(map->state);
  for (const auto& block : snapshot->point_blocks) {
    demand_sent(wire::PointPatches{header.id, header.epoch, *block->patches});
    demand_sent(wire::PointPositions{header.id, header.epoch, *block->positions});
  }
  for (const auto& block : snapshot->keyframe_blocks)
    demand_sent(wire::KeyframePoses{header.id, header.epoch, *block});
  for (const LabelRecord& l : import.labels()) {
    demand_sent(wire::LabelMessage{
        header.id, header.epoch, {LabelId{l.id}, l.kind, l.text, l.map_from_label, l.author, l.time}});
  }
}

std::vector<Input> seeds() {
  const MapRecord map = small_record();
  const Blob image = encode_image_row(small_image());
  Input known;
  Input found;
  for (Input* out : {&known, &found}) {
    put(kCounts, 0, encode_header({small_header(), map.keyframe_count, map.point_count}), out);
    put(kFoundation, 0, encode_foundation(*map.foundation), out);
    put(kCameras, out == &known ? 1 : 200, encode_camera(small_camera()->parameters()), out);
  }
  const MapCamera camera = make_map_camera(small_camera(), {{ClientId{{1, 2}}, 3, 4}, {0.1, 0.2}});
  put(kCalibratedCameras, 0, encode_calibrated_camera(camera), &found);
  for (Input* out : {&known, &found}) {
    for (size_t i = 0; i < map.keyframes.size(); ++i) {
      put(kKeyframes, i + 1, encode_keyframe(map.keyframes[i], out == &known ? 1 : calibrated_camera_row(0)),
          out);
      put(kImages, i + 1, image, out);
      put(kMeasurements, i + 1, encode_measurements(map.measurements[i]), out);
    }
    put(kSources, 0, encode_sources(map.sources[0]), out);
    put(kPositions, 0, encode_positions(map.positions[0]), out);
    put(kLabels, 1, encode_label(small_label()), out);
  }
  return {known, found};
}

}  // namespace cairn::fuzz
