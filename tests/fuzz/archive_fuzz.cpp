// SPDX-License-Identifier: Apache-2.0
//
// Archives of maps: whole files as an operator may import them, and the rows of their tables. The first byte
// says which; 0 is a file.
#include <unistd.h>

#include <array>
#include <fstream>
#include <iterator>
#include <optional>

#include "server/store/entry_codec.h"
#include "server/store/row_codec.h"
#include "server/store/store.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {
namespace {

using Bytes = std::span<const uint8_t>;

CameraPtr camera() {
  static const CameraPtr made =
      *make_camera({CameraModel::kPinholeRadtan, 640, 480, {525, 525, 320, 240, 0, 0, 0, 0, 0}});
  return made;
}
const CameraRows& cameras() {
  static const CameraRows rows{{1, camera()}};
  return rows;
}

/// What is read from a row is written as a row that is read.
template <typename Decode, typename Encode>
void round_trip(Bytes row, const Decode& decode, const Encode& encode) {
  const auto record = decode(row);
  if (!record) return;
  const Blob again = encode(*record);
  demand(decode(Bytes(again)).has_value(), "a row that is read is written and read back");
}

using Decoder = void (*)(Bytes);
constexpr std::array<Decoder, 14> kRows{
    [](Bytes row) { round_trip(row, decode_camera, encode_camera); },
    [](Bytes row) { static_cast<void>(decode_found_camera(1, row, cameras())); },
    [](Bytes row) {
      round_trip(
          row, [](Bytes r) { return decode_keyframe(KeyframeId{1}, r, cameras()); },
          [](const KeyframeRecord& k) { return encode_keyframe(k, 1); });
    },
    [](Bytes row) {
      round_trip(
          row, [](Bytes r) { return decode_measurements(KeyframeId{1}, r); }, encode_measurements);
    },
    [](Bytes row) {
      round_trip(
          row, [](Bytes r) { return decode_sources(0, r); }, encode_sources);
    },
    [](Bytes row) {
      round_trip(
          row, [](Bytes r) { return decode_positions(0, r); }, encode_positions);
    },
    [](Bytes row) { round_trip(row, decode_foundation, encode_foundation); },
    [](Bytes row) { round_trip(row, decode_work, encode_work); },
    [](Bytes row) { static_cast<void>(decode_image_row(row)); },
    [](Bytes row) { round_trip(row, decode_header, encode_header); },
    [](Bytes row) {
      round_trip(
          row, [](Bytes r) { return decode_epoch(1, r); }, encode_epoch);
    },
    [](Bytes row) { round_trip(row, decode_decision, encode_decision); },
    [](Bytes row) {
      round_trip(
          row, [](Bytes r) { return decode_label(1, r); }, encode_label);
    },
    [](Bytes row) { round_trip(row, decode_overlap, encode_overlap); },
};

void decode_file(Bytes bytes) {
  const MemoryFile file(bytes);
  static_cast<void>(read_archive(file.path()));
}

SE3 pose() {
  return {Eigen::Quaterniond(0.9, 0.1, 0.2, 0.3).normalized(), {1, 2, 3}};
}

SourcesRecord sources() {
  SourcesRecord record{0, {}};
  PointSource& point = record.points.emplace_back();
  point.id = PointId{1};
  point.keyframe = KeyframeId{1};
  point.corner = {100, 120};
  point.ray_center = point.ray_right = point.ray_down = point.normal = {0, 0, 1};
  return record;
}

LabelRecord label() {
  LabelRecord record;
  record.id = 1;
  record.text = "kettle";
  record.author = "ann";
  return record;
}

DecisionRecord decision() {
  DecisionRecord record;
  record.client = "ann";
  record.session = SessionId{42};
  record.seq = 7;
  record.reason = "too close";
  record.seed_points = {{TrailId{1}, PointId{1}}};
  return record;
}

MapHeader header() {
  MapHeader made;
  made.id.bytes.fill(7);
  made.name = "desk";
  made.epoch = Epoch{3};
  return made;
}

GrayImage picture() {
  GrayImage image(32, 24);
  for (int y = 0; y < 24; ++y)
    for (int x = 0; x < 32; ++x) image.row(y)[x] = static_cast<uint8_t>(8 * x ^ 5 * y);
  return image;
}

MapRecord record() {
  MapRecord made;
  made.keyframe_count = 2;
  made.point_count = 1;
  made.foundation = FoundationRecord{0.07, true};
  made.work = WorkRecord{{{KeyframeId{1}, 2, 777, 31}}, {PointId{1}}, KeyframeId{1}, true, false, true};
  for (const KeyframeId id : {KeyframeId{1}, KeyframeId{2}}) {
    made.keyframes.push_back({id, {}, camera(), Timestamp{17}, pose(), 3, 1, 10, true});
    made.measurements.push_back({id, {{PointId{1}, 0, {100, 120}}}, {}});
    made.images.push_back({id, std::make_shared<const GrayImage>(picture())});
  }
  made.sources.push_back(sources());
  made.positions.push_back({0, {{{1, 2, 3}, 4, 2, true}}});
  return made;
}

/// A map as a file.
Blob file() {
  const auto path = std::filesystem::temp_directory_path() / ("archive_fuzz." + std::to_string(::getpid()));
  {
    auto made = MapFile::create(path, header(), {record(), {decision()}, {label()}, {}});
    demand(made.has_value() && made->write_back().has_value(), "a map can be written");
  }
  std::ifstream in(path, std::ios::binary);
  Blob bytes{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  std::filesystem::remove(path);
  return bytes;
}

}  // namespace

std::vector<std::vector<uint8_t>> seeds() {
  const MapRecord whole = record();
  std::vector<Blob> all{
      file(),
      encode_camera(camera()->parameters()),
      encode_found_camera(make_map_camera(camera(), {{ClientId{{1, 2}}, 3, 4}, {0.1, 0.2}})),
      encode_keyframe(whole.keyframes[0], 1),
      encode_measurements(whole.measurements[0]),
      encode_sources(whole.sources[0]),
      encode_positions(whole.positions[0]),
      encode_foundation(*whole.foundation),
      encode_work(*whole.work),
      encode_image_row(picture()),
      encode_header({header(), 1, 1}),
      encode_epoch({Epoch{1}, 2, 3}),
      encode_decision(decision()),
      encode_label(label()),
      encode_overlap({MapId{{1}}, MapId{{2}}, 3, 4, Timestamp{5}})};
  for (size_t i = 0; i < all.size(); ++i) all[i].insert(all[i].begin(), static_cast<uint8_t>(i));
  return all;
}

void decode(Bytes bytes) {
  if (bytes.empty()) return;
  if (bytes[0] == 0) return decode_file(bytes.subspan(1));
  kRows[(bytes[0] - 1U) % kRows.size()](bytes.subspan(1));
}

}  // namespace cairn::fuzz
