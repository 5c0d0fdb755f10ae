// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/geometry/se3.h"
#include "common/image/image.h"
#include "common/image/still_mask.h"
#include "common/map/extent.h"
#include "common/map/ids.h"
#include "common/map/keyframe_view.h"
#include "common/map/limits.h"
#include "common/map/observations.h"
#include "common/map/snapshot.h"
#include "server/mapping/map_camera.h"
#include "server/mapping/map_maker_options.h"

/// The map maker (PTAM 2007, section 6): two-view start, keyframe integration, bundle adjustment, upkeep.
/// Pure: no threads, clocks, files or DDS; equal inputs give equal bytes. One writer: a MapMaker is used from
/// one serial queue at a time.
namespace cairn {

/// Two views of a camera and the trails between them.
struct SeedInput {
  MapId map;
  std::string map_name;
  Epoch epoch;
  CameraPtr camera;
  Timestamp first_time;
  Timestamp second_time;
  GrayImagePtr first_image;
  GrayImagePtr second_image;
  std::vector<Trail> trails;
  /// The tracker's motion, |translation| = 1: it has judged by more views than these two.
  SE3 second_from_first;
  /// Prior of a camera that is to be calibrated; nothing: the values of `camera` are exact.
  std::optional<CameraPrior> prior = {};
  /// Mask of what stands still in both images, where no point is made; null: nothing does.
  StillMaskPtr still = {};
  std::optional<UpDirection> second_up = {};  ///< in the axes of the second view; nothing: not known
  /// Extent, in the frame of the map that it makes, in which its cameras must lie; points outside are left
  /// out. Nothing: everywhere.
  std::optional<Extent> extent = {};
};

struct SeedResult {
  KeyframeId first_keyframe;
  KeyframeId second_keyframe;
  std::vector<std::pair<TrailId, PointId>> points;
  bool plane_aligned = false;
};

/// A frame that wants to become a keyframe. The pose is composed with the reference keyframe's present pose.
struct KeyframeInput {
  CameraPtr camera;
  Timestamp time;
  GrayImagePtr image;
  KeyframeId reference;
  SE3 camera_from_reference;
  std::vector<PointMeasurement> measurements;
  std::vector<PointCandidate> candidates = {};
  /// As SeedInput::prior; what the map already knows of the camera counts more.
  std::optional<CameraPrior> prior = {};
  /// It was tracked against a frame that was no keyframe yet, so points of the map that were made since then
  /// are looked for in it.
  bool is_chained = false;
  StillMaskPtr still = {};             ///< as SeedInput's
  std::optional<UpDirection> up = {};  ///< in the camera's axes; nothing: not known
  /// Extent in which its camera must lie, and outside of which no point is made for it; nothing: everywhere.
  /// Points that are there already are measured wherever they are.
  std::optional<Extent> extent = {};
  /// Its client may add and not take away: no keyframe or point gives way because it has come, then or later.
  bool adds_only = false;
};

/// Gives the image of a frame that has come without one. An error: it cannot be used.
using DecodeImage = std::function<Result<GrayImagePtr>()>;

/// Error kDamaged if an image is not of the size of the camera that it is said to be of.
[[nodiscard]] Status check_image_size(const GrayImage& image, const Camera& camera);

enum class KeyframeVerdict : uint8_t {
  kAccepted,
  kTooClose,
  kTooFewPoints,
  kStale,
  kDamaged,
  kFull,
  kOutside,  ///< the camera is not within the frame's extent
};

struct KeyframeDecision {
  KeyframeVerdict verdict = KeyframeVerdict::kAccepted;
  std::string reason;   ///< for a person; empty when accepted
  KeyframeId keyframe;  ///< when accepted
};

/// What a unit of work did, for logs, metrics and benchmarks.
enum class MapWork : uint8_t { kNone, kNewPoints, kLocalAdjustment, kRefind, kGlobalAdjustment, kCull };
struct StepReport {
  MapWork work = MapWork::kNone;
  bool finished = true;  ///< false: yielded to a waiting keyframe, to be taken up again
  bool changed = false;  ///< the map differs: publish
  int observations = 0;  ///< of an adjustment
  int iterations = 0;
  KeyframeId keyframe = {};  ///< the keyframe whose new points are all made, if any
};

/// What a map says of a camera that it calibrates.
struct CameraEstimate {
  CameraVersion version;
  CameraPtr camera;
  Intrinsics sigma = Intrinsics::Zero();
  bool frozen = false;           ///< will not change any more
  bool cannot_be_known = false;  ///< many keyframes have not told the focal length: sigma stays large
};

struct MapStatistics {
  size_t keyframes = 0;
  size_t points = 0;
  size_t measurements = 0;
  size_t bytes = 0;  ///< memory of the map beside what was published, with the images that are there or that
                     ///< due work needs
  size_t evicted_bytes = 0;   ///< of images that are not there and will only be needed by new work; about
  size_t without_images = 0;  ///< keyframes whose images have been evicted
  Eigen::Vector3f bounds_min = Eigen::Vector3f::Zero();  ///< 1 % to 99 % of the points
  Eigen::Vector3f bounds_max = Eigen::Vector3f::Zero();
  std::vector<CameraEstimate> cameras;  ///< as in the last snapshot
};

/// A copy of what a global adjustment needs; solved on any thread while the map goes on.
class GlobalAdjustment;
struct GlobalAdjustmentDeleter {
  void operator()(GlobalAdjustment* problem) const;
};
using GlobalAdjustmentPtr = std::unique_ptr<GlobalAdjustment, GlobalAdjustmentDeleter>;

struct MapRecord;  // map_record.h

/// What a map is called, and in which epoch it is served.
struct MapIdentity {
  MapId map;
  std::string name;
  Epoch epoch;
};

/// Whether the images in a record are given to the map maker, or left out as after MapMaker::evict_images().
enum class RestoredImages : uint8_t { kStay, kEvicted };

class MapMaker {
 public:
  /// Makes a map of two keyframes or says why not (message for a person: "no parallax: ..."). The dominant
  /// plane, where there is one, becomes Z = 0, the baseline `options.baseline`. From here on
  /// adjustments leave the map as a whole where it was (write_back).
  [[nodiscard]] static Result<std::pair<std::unique_ptr<MapMaker>, SeedResult>> start(
      const SeedInput& input, const MapMakerOptions& options);
  /// A map as it was when its record was taken: it goes on as the original would have, in a new epoch.
  /// Precondition: `record` is whole. `repairs` name what had to be left out of it. Error kDamaged when no
  /// map is left.
  struct Restored {
    std::unique_ptr<MapMaker> maker;
    std::vector<std::string> repairs;
  };
  [[nodiscard]] static Result<Restored> restore(const MapRecord& record, const MapIdentity& identity,
                                                const MapMakerOptions& options,
                                                RestoredImages images = RestoredImages::kStay);
  ~MapMaker();
  MapMaker(const MapMaker&) = delete;
  MapMaker& operator=(const MapMaker&) = delete;

  /// Judges a frame (re-optimizes its pose on its measurements first) and takes it in: keyframe,
  /// measurements of known points and points of its candidates are in the map on return, the rest is work
  /// for step(). Candidates that come while images are evicted are passed over. A few milliseconds.
  /// Refused as kFull while there is still room for the points of all keyframes taken before. `decode` is
  /// asked for an image that is not in `input`: of a chained frame at once, as more points are looked for in
  /// it; of any other once enough of its measurements agree with the map.
  [[nodiscard]] KeyframeDecision add_keyframe(const KeyframeInput& input, const DecodeImage& decode = {});

  /// Whether a step() or a global adjustment has anything to do.
  [[nodiscard]] bool has_work() const;

  /// Does the most urgent unit of work: new points for keyframes, oldest first, local adjustment, re-finding
  /// of new points in old keyframes, culling. `should_yield` is polled at least every 10 ms; when true the
  /// step returns early (finished = false). Global adjustment is not done here. work == kNone when there is
  /// nothing to do.
  StepReport step(const std::function<bool()>& should_yield);

  /// Whether a global adjustment would be worth its time now; the problem is a copy (of poses, points,
  /// measurements).
  [[nodiscard]] bool wants_global_adjustment() const;
  [[nodiscard]] GlobalAdjustmentPtr prepare_global_adjustment() const;
  /// Adopts a solved problem: what is newer than the copy rides on the correction of its reference keyframe.
  /// Keeps the last good map (and says so in the report) when the solution is not finite or worse.
  StepReport adopt(const GlobalAdjustment& solved);

  /// The map as of now, as blocks; blocks in which nothing changed visibly (PublicationOptions) since they
  /// were last cut are shared with the previous snapshot. The revision grows only if something changed.
  [[nodiscard]] MapSnapshotPtr snapshot();

  /// Live keyframes with their images and measurements, ascending by id, for the relocalizer. Those whose
  /// images have been evicted come without an image; their measurements are what they were then.
  [[nodiscard]] std::vector<KeyframeView> keyframe_views() const;

  /// Gives the map a name, which the next snapshot has.
  void rename(const std::string& name);

  /// Some hundred microseconds for ten thousand points.
  [[nodiscard]] MapStatistics statistics() const;
  /// Root mean square of the reprojection errors of all measurements [level-0 px], as the map is now; those
  /// whose point does not project do not count. Takes some milliseconds, so it is not for every revision.
  [[nodiscard]] double reprojection_rms() const;

  /// Returns what has to be kept of the changes since the last call; the first time, all of the map.
  [[nodiscard]] MapRecord take_changes();
  /// Makes the next take_changes() return all of the map, since changes taken before could not be kept.
  void keep_everything_anew();

  /// Frees the images that take_changes() has returned, which are most of a map's memory. Precondition: all
  /// of that has been kept, and there is no work. The map can still be looked at, renamed and kept, and takes
  /// keyframes, which bring their images; step() and adopt() need all images back.
  void evict_images();
  /// Whether any keyframe's images have been evicted.
  [[nodiscard]] bool lacks_any_images() const;
  /// Keyframes whose images have been evicted, ascending.
  [[nodiscard]] std::vector<KeyframeId> lacking_images() const;
  /// Gives an image back as it was kept (ImageRecord): with all of them the map is what it was. Returns false
  /// if the image is not of the size of the keyframe's camera. Some milliseconds.
  [[nodiscard]] bool page_in_image(KeyframeId keyframe, const GrayView& image);

 private:
  struct State;
  explicit MapMaker(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Solves an adjustment in place. `should_stop` is polled about every millisecond; the last whole iteration
/// is kept.
void solve(GlobalAdjustment* problem, const std::function<bool()>& should_stop);

}  // namespace cairn
