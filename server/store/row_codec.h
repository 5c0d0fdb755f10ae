// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/geometry/camera.h"
#include "server/mapping/map_record.h"
#include "server/store/bytes.h"

/// The blobs of a map file's rows (FORMAT.md has the table). encode_*() of equal values gives equal bytes,
/// and decode_*() gives back the value bit by bit; it believes nothing: numbers out of range, lists out of
/// order and bytes too many or too few make it give nothing. Pure.
namespace cairn {

using Blob = std::vector<uint8_t>;

void put_pose(const SE3& pose, ByteWriter* out);
/// Reads a pose; nothing when it is none: numbers out of range, no rotation.
[[nodiscard]] std::optional<SE3> get_pose(ByteReader* in);

[[nodiscard]] Blob encode_camera(const CameraParameters& camera);
[[nodiscard]] std::optional<CameraParameters> decode_camera(std::span<const uint8_t> row);

/// Whether a time is within 146 years of the epoch, as on the wire, so that differences of two never
/// overflow.
[[nodiscard]] bool is_time(Timestamp time);

/// Cameras by their row in the file. Exact ones have rows from 1 on; one that is self-calibrated, whose
/// values change with the map, has a row below 0.
using CameraRows = std::map<int64_t, CameraPtr>;
[[nodiscard]] constexpr int64_t calibrated_camera_row(int index) {
  return -1 - int64_t{index};
}
/// Encodes what is known of a self-calibrated camera, but for its values.
[[nodiscard]] Blob encode_calibrated_camera(const MapCamera& camera);
[[nodiscard]] std::optional<CalibratedCameraRecord> decode_calibrated_camera(int index,
                                                                             std::span<const uint8_t> row,
                                                                             const CameraRows& cameras);

[[nodiscard]] Blob encode_keyframe(const KeyframeRecord& keyframe, int64_t camera);
[[nodiscard]] std::optional<KeyframeRecord> decode_keyframe(KeyframeId id, std::span<const uint8_t> row,
                                                            const CameraRows& cameras);

[[nodiscard]] Blob encode_measurements(const MeasurementsRecord& measurements);
[[nodiscard]] std::optional<MeasurementsRecord> decode_measurements(KeyframeId id,
                                                                    std::span<const uint8_t> row);

[[nodiscard]] Blob encode_sources(const SourcesRecord& sources);
[[nodiscard]] std::optional<SourcesRecord> decode_sources(uint32_t block, std::span<const uint8_t> row);

[[nodiscard]] Blob encode_positions(const PositionsRecord& positions);
[[nodiscard]] std::optional<PositionsRecord> decode_positions(uint32_t block, std::span<const uint8_t> row);

[[nodiscard]] Blob encode_foundation(const FoundationRecord& foundation);
[[nodiscard]] std::optional<FoundationRecord> decode_foundation(std::span<const uint8_t> row);

[[nodiscard]] Blob encode_work(const WorkRecord& work);
[[nodiscard]] std::optional<WorkRecord> decode_work(std::span<const uint8_t> row);

/// PNG, lossless: 7 ms to write and 3 ms to read for 640x480, 0.4 to 0.5 of the raw size (other codings:
/// tests/bench/HISTORY.md).
[[nodiscard]] Blob encode_image_row(const GrayImage& image);
[[nodiscard]] GrayImagePtr decode_image_row(std::span<const uint8_t> row);  ///< null: not an image

}  // namespace cairn
