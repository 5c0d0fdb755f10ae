// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "client/inertial/imu_stream.h"
#include "common/base/result.h"
#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/image/image.h"

namespace cairn {

/// One image of a camera or a recording.
struct Frame {
  uint64_t index =
      0;           ///< within the source, from 0; a frame that cannot be decoded or was dropped leaves a gap
  Timestamp time;  ///< of capture; recordings may jump, also backwards
  GrayImagePtr image;
};

/// A sentence that names a source and says what a person should know of it before its frames are used.
struct SourceNote {
  std::string text;
  bool is_warning = false;  ///< else it tells what is done by itself
};

/// A source of frames. Used by one thread at a time.
class FrameSource {
 public:
  virtual ~FrameSource() = default;

  /// The next frame, nothing at the end (and ever after). An error (kDamaged, kNotFound, kIo) is about one
  /// frame and names its file; the next call goes on with the frame after it. Blocks while a live camera
  /// exposes.
  [[nodiscard]] virtual Result<std::optional<Frame>> next() = 0;
  /// How many frames the source holds, as far as its lists or its container tell; nothing for a live camera.
  [[nodiscard]] virtual std::optional<size_t> frame_count() const = 0;
  /// Exact calibration of a source that knows it (the simulator).
  [[nodiscard]] virtual std::optional<CameraParameters> builtin_calibration() const { return std::nullopt; }
  /// Size of its frames, where it can tell without reading frames.
  [[nodiscard]] virtual std::optional<ImageSize> image_size() const { return std::nullopt; }
  /// Times of its first and its last frame, where it can tell without reading frames.
  [[nodiscard]] virtual std::optional<std::pair<Timestamp, Timestamp>> time_span() const {
    return std::nullopt;
  }
  /// The samples of the IMU on its camera, for once; null where it has none of its own.
  [[nodiscard]] virtual ImuStreamPtr take_imu() { return nullptr; }
  /// Says to a person what the source is, without frames being read.
  [[nodiscard]] virtual std::string describe() const = 0;
  /// The notes that were made when the source was opened.
  [[nodiscard]] virtual std::vector<SourceNote> notes() const { return {}; }
  /// Whether frames come by the clock of a camera and are lost when not taken.
  [[nodiscard]] virtual bool is_live() const { return false; }
};

/// Opens what a `--source` argument names:
///  * `tum:DIR`: rgb.txt with rows `time file`, files relative to DIR; frames in the file's order
///  * `euroc:DIR?camera=cam0`: mav0/cam0/data.csv in DIR, or cam0/data.csv
///  * `images:DIR?fps=30`, or `times=FILE`: png, jpg, jpeg, pgm, ppm in natural order (2 before 10); `match=`
///  takes those whose names match a glob
///  * `video:FILE?times=FILE`: whatever OpenCV's FFmpeg reads, turned as the file says; stamped by the list,
///  else by the container
///  * `v4l2:/dev/video0?size=640x480&fps=30`: a camera; an error when it gives no image for 2 s
///  * `sim:SCENARIO?seed=1&camera=hand`: with CAIRN_SIMULATOR; further options are the simulator's;
///  `rig=PATH`: what the camera of `cairn-rig simulate --camera PATH` sees, live
/// A `times=FILE` has one time a line. `unit=s|ms|us|ns` says what the times of any list count. Of images
/// of different sizes, those of the commonest size are frames, the others errors.
/// Errors: kUsage (unknown scheme or option; lists the valid ones), kNotFound, kIo, kConfiguration (images
/// of several kinds in one folder), kDamaged (lists that do not parse, are empty, or have stamps of no
/// camera).
[[nodiscard]] Result<std::unique_ptr<FrameSource>> open_source(std::string_view uri);

/// The files that a source reads beside its images: lists, time stamps, the video. Whether they are there
/// is not looked at; none for what open_source() would refuse.
[[nodiscard]] std::vector<std::filesystem::path> source_files(std::string_view uri);

/// Checks before the first frame what a loop would say of it: kConfiguration where the frames have another
/// size than the calibration, also if only width and height are exchanged. A source that knows its size only
/// from its frames passes.
[[nodiscard]] Status check_image_size(const FrameSource& source, const CameraParameters& calibration);

/// camera.txt beside the images or the video of a source, or sensor.yaml in a EuRoC folder, if there is one.
[[nodiscard]] std::optional<std::filesystem::path> find_calibration(std::string_view uri);

}  // namespace cairn
