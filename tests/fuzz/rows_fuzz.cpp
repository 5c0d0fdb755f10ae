// SPDX-License-Identifier: Apache-2.0
//
// The rows of a map's tables, as archives bring them. The first byte says which table.
#include <array>

#include "server/store/proposal_codec.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/fuzz/small_map.h"

namespace cairn::fuzz {
namespace {

const CameraRows& cameras() {
  static const CameraRows rows{{1, small_camera()}};
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
constexpr std::array<Decoder, 16> kTables{
    [](Bytes row) { round_trip(row, decode_camera, encode_camera); },
    [](Bytes row) { static_cast<void>(decode_calibrated_camera(1, row, cameras())); },
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
    [](Bytes row) {
      round_trip(
          row, [](Bytes r) { return decode_tag(1, r); }, encode_tag);
    },
    [](Bytes row) {
      round_trip(
          row, [](Bytes r) { return decode_proposal(1, r); }, encode_proposal);
    },
};

ProposalRecord proposal() {
  ProposalRecord made;
  made.summary.client = "phone-1";
  made.summary.why = "too close";
  made.summary.expected = made.summary.found = 30;
  made.reference = KeyframeId{1};
  made.camera = small_camera()->parameters();
  made.measurements = {{PointId{1}, 0, {10, 12}}};
  made.candidates = {{CandidateId{1}, 0, {20, 12}, 0.5F, 0.1F}};
  return made;
}

}  // namespace

void decode(Bytes bytes) {
  if (bytes.empty()) return;
  kTables.at(bytes[0] % kTables.size())(bytes.subspan(1));
}

std::vector<Input> seeds() {
  const MapRecord map = small_record();
  const MapCamera found = make_map_camera(small_camera(), {{ClientId{{1, 2}}, 3, 4}, {0.1, 0.2}});
  const std::array<Blob, kTables.size()> rows{encode_camera(small_camera()->parameters()),
                                              encode_calibrated_camera(found),
                                              encode_keyframe(map.keyframes[0], 1),
                                              encode_measurements(map.measurements[0]),
                                              encode_sources(map.sources[0]),
                                              encode_positions(map.positions[0]),
                                              encode_foundation(*map.foundation),
                                              encode_work(*map.work),
                                              encode_image_row(small_image()),
                                              encode_header({small_header(), 2, 3}),
                                              encode_epoch({Epoch{1}, 2, 3}),
                                              encode_decision(small_decision()),
                                              encode_label(small_label()),
                                              encode_overlap({MapId{{1}}, MapId{{2}}, 3, 4, Timestamp{5}}),
                                              encode_tag({1, "v1", Timestamp{5}, "ann", 2, 3, 2, 3}),
                                              encode_proposal(proposal())};
  std::vector<Input> all;
  for (size_t i = 0; i < rows.size(); ++i) all.push_back(input_of(i, rows.at(i)));
  return all;
}

}  // namespace cairn::fuzz
