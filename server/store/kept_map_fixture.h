// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <vector>

#include "common/io/test_directory.h"
#include "server/mapping/map_maker_fixture.h"
#include "server/mapping/map_record.h"
#include "server/store/map_file.h"
#include "server/store/row_codec.h"

namespace cairn::testing {

/// All that a map is, as bytes, in the order of its ids.
[[nodiscard]] inline std::vector<uint8_t> bytes_of(const MapRecord& record) {
  std::vector<uint8_t> bytes;
  const auto add = [&bytes](const Blob& row) { bytes.insert(bytes.end(), row.begin(), row.end()); };
  if (record.foundation) add(encode_foundation(*record.foundation));
  if (record.work) add(encode_work(*record.work));
  for (const auto& r : record.calibrated_cameras) {
    add(encode_camera(r.camera.camera->parameters()));
    add(encode_calibrated_camera(r.camera));
  }
  for (const auto& r : record.keyframes) add(encode_keyframe(r, r.estimated_camera));
  for (const auto& r : record.measurements) add(encode_measurements(r));
  for (const auto& r : record.images) add(encode_image_row(*r.image));
  for (const auto& r : record.sources) add(encode_sources(r));
  for (const auto& r : record.positions) add(encode_positions(r));
  return bytes;
}

/// A map of the test scene, and a folder of its own to keep it in.
class KeptMapFixture : public MapMakerFixture {
 protected:
  KeptMapFixture() {
    header_.id = MapId{{7, 1}};
    header_.name = "desk";
    header_.epoch = Epoch{3};
  }

  [[nodiscard]] MapUpdate take_update() { return {maker_->take_changes(), {}, {}, {}}; }
  /// All of the map as it is.
  [[nodiscard]] MapRecord whole() {
    maker_->keep_everything_anew();
    return maker_->take_changes();
  }
  [[nodiscard]] static DecisionRecord decision(uint64_t seq) {
    DecisionRecord made;
    made.client = "anna";
    made.session = SessionId{42};
    made.seq = seq;
    made.reason = "because";
    return made;
  }

  TestDirectory directory_;
  const std::filesystem::path& folder_ = directory_.path();
  MapHeader header_;
};

}  // namespace cairn::testing
