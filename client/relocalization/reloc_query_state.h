// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "client/relocalization/pose_hypothesis.h"
#include "client/relocalization/rejected_hypotheses.h"
#include "common/base/time.h"
#include "common/geometry/camera.h"
#include "common/image/frame_images.h"
#include "common/image/place.h"
#include "common/map/snapshot.h"

namespace cairn {

struct RelocQueryOptions {
  double interval = 1.0 / 15 - 1e-3;  ///< [s] between two queries, at least, where the first was answered
  double patience = 0.5;              ///< [s] for an answer; then another query is made
  double fresh = 1.0;                 ///< [s] for which an answer says what is
  uint64_t much_to_see = 100;         ///< corners, of the 880 that are described at most
  RejectedHypothesesOptions rejected;
};

/// The relocalization query (where is the camera?) and its answer, as the tracker sees them: one query is
/// under way, at most 15 are made a second in the time of the frames, and one without an answer is given up
/// after half a second. Pure; one thread.
class RelocQueryState {
 public:
  explicit RelocQueryState(const RelocQueryOptions& options)
      : options_(options), rejected_(options.rejected) {}

  /// The frame described, if a query may be made now; else null.
  [[nodiscard]] std::shared_ptr<const PlaceView> ask(const FrameImages& frame, Timestamp time,
                                                     const std::optional<UpDirection>& up = {});
  /// Takes the answer: a hypothesis, or that no place is known. Returns whether there is a hypothesis to
  /// verify: one that was rejected again and again counts as none.
  bool answered(const std::optional<PoseHypothesis>& hypothesis);
  /// The answer says neither. What was known before holds; the next query may be made.
  void left_open() {
    under_way_ = false;
    nobody_answers_ = false;
  }
  /// The place taken last did not show in the frame, or not in the next ones.
  void reject(Timestamp time);
  /// The place taken last did show: the camera is where the map says.
  void verified() {
    taken_.reset();
    hypothesis_.reset();
    rejected_.forget();
    shows_much_ = is_elsewhere_ = false;  // an answer that is still to come is about before
    under_way_ = false;                   // and nobody waits for it any more
  }
  void drop_hypothesis() { hypothesis_.reset(); }
  /// Forgets everything but the places rejected: a tracker that starts over must not be led to them again.
  void restart();

  /// Whether a hypothesis in this map waits to be verified.
  [[nodiscard]] bool has_hypothesis_in(const MapSnapshot& map) const;
  /// The hypothesis, to be verified once, as a pose of the present frame: turned since the query as the
  /// tiny images say. Nothing when the map is another or its keyframe has gone.
  [[nodiscard]] std::optional<SE3> take(const FrameImages& frame, const Camera& camera,
                                        const MapSnapshot& map);
  /// Whether geometry confirms the place taken last.
  [[nodiscard]] bool took_confirmed() const { return taken_ && taken_->confirmed; }
  /// Whether the latest answer is "not known", about a frame not older than `begin` and fresh at `time`.
  [[nodiscard]] bool is_not_known(Timestamp begin, Timestamp time) const;
  /// Whether the camera is elsewhere: no place was known of an image with much to see, asked about since the
  /// last verified(), or contradict() says so. An answer about a hand before the lens, or about blur, does
  /// not.
  [[nodiscard]] bool is_elsewhere() const { return is_elsewhere_; }
  /// Whether a query made at `begin` or later has been answered.
  [[nodiscard]] bool is_answered_since(Timestamp begin) const { return answered_ && *answered_ >= begin; }
  /// The camera is elsewhere: it was confirmed in another map than the one it was looked for in.
  void contradict() { is_elsewhere_ = true; }
  /// Whether the latest query that could have been answered was not.
  [[nodiscard]] bool nobody_answers() const { return nobody_answers_; }

 private:
  RelocQueryOptions options_;
  std::optional<Timestamp> asked_;  ///< when the latest query was made
  bool under_way_ = false;
  bool nobody_answers_ = false;
  TinyImage tiny_;                      ///< of the frame asked about
  std::optional<Timestamp> answered_;   ///< when the frame was taken of which the latest answer is
  std::optional<Timestamp> not_known_;  ///< when the frame was taken of which the latest answer says so
  bool shows_much_ = false;             ///< the frame asked about
  bool is_elsewhere_ = false;
  std::optional<PoseHypothesis> hypothesis_;
  std::optional<PoseHypothesis> taken_;  ///< and not rejected yet
  RejectedHypotheses rejected_;
};

}  // namespace cairn
