// SPDX-License-Identifier: Apache-2.0
#include "server/service/proposal_judge.h"

#include <algorithm>

#include "common/geometry/scene_depth.h"
#include "server/service/map_runner.h"
#include "server/store/epochs.h"
#include "server/store/proposal_codec.h"

namespace cairn {
namespace {

constexpr size_t kMostPoints = 2000;  ///< looked for in an image
constexpr size_t kLeastFound = 20;    ///< as the map maker asks of a keyframe

/// Pose of the frame (camera_from_map); nothing if the keyframe that it is relative to has gone.
std::optional<SE3> pose_in(const MapSnapshot& map, KeyframeId reference, const SE3& camera_from_reference) {
  const KeyframePose* keyframe = map.find(reference);
  if (keyframe == nullptr) return std::nullopt;
  return camera_from_reference * keyframe->camera_from_map;
}

ProposalJudgement refuse(wire::OfferDecision decision, std::string reason) {
  return {decision, std::move(reason), {}};
}

}  // namespace

ProposalJudgement judge_proposal(const MapSnapshot& map, const Camera& camera,
                                 const wire::KeyframeOffer& offer, const RefindOptions& options) {
  using wire::OfferDecision;
  const auto pose = offer.epoch == map.epoch && offer.reference_command == 0
                        ? pose_in(map, offer.reference, offer.camera_from_reference)
                        : std::nullopt;
  if (!pose) return refuse(OfferDecision::kStale, "what its pose is relative to is not in the map now");
  const Result<GrayImagePtr> image = decode_image(offer.image);
  if (!image) return refuse(OfferDecision::kDamaged, image.error().message);
  if (Status fits = check_image_size(**image, camera); !fits)
    return refuse(OfferDecision::kDamaged, std::move(fits.error().message));
  const StillMaskPtr still = still_mask_of(camera.width(), camera.height(), offer.still_mask);
  const auto images = prepare_images((**image).view(), still);
  const auto points = expected_points(map, camera, *pose, *images, still, kMostPoints, options);
  std::vector<double> depths;
  for (const ExpectedPoint& point : points)
    if (point.found) depths.push_back(point.depth);
  if (depths.size() < kLeastFound)
    return refuse(OfferDecision::kTooFewPoints,
                  "its image shows " + std::to_string(depths.size()) + " of the " +
                      std::to_string(points.size()) + " points of the map that should be in it, " +
                      std::to_string(kLeastFound) + " needed: what it shows is not this map");
  ProposalJudgement judged;
  ProposalRecord& record = judged.kept.record;
  record.summary.session = offer.command.session;
  record.summary.seq = offer.command.seq;
  record.summary.time = offer.time;
  record.summary.epoch = offer.epoch;
  record.summary.camera_from_map = *pose;
  record.summary.expected = static_cast<uint32_t>(points.size());
  record.summary.found = static_cast<uint32_t>(depths.size());
  record.summary.mean_depth = scene_depth(&depths);
  record.reference = offer.reference;
  record.camera_from_reference = offer.camera_from_reference;
  record.camera = camera.parameters();
  record.measurements = offer.measurements;
  record.candidates = offer.candidates;
  record.still_mask = bits_of(still);
  record.up = offer.up;
  judged.kept.image = encode_image_row(**image);
  record.summary.bytes = judged.kept.image.size() + encode_proposal(record).size();
  return judged;
}

Result<std::vector<ExpectedPoint>> points_in(const MapSnapshot& map, std::span<const EpochRecord> epochs,
                                             const KeptProposal& proposal, const RefindOptions& options) {
  const ProposalRecord& record = proposal.record;
  const auto same = ids_in_common(epochs, record.summary.epoch, map.epoch);
  const auto pose = same && record.reference.value <= same->keyframes
                        ? pose_in(map, record.reference, record.camera_from_reference)
                        : std::nullopt;
  if (!pose)
    return fail(ErrorCode::kRefused,
                "the keyframe that it was taken beside is in the map no more: it cannot be accepted");
  const auto camera = make_camera(record.camera);
  if (!camera) return tl::unexpected(camera.error());
  const GrayImagePtr image = decode_image_row(proposal.image);
  if (image == nullptr || image->width() != (**camera).width() || image->height() != (**camera).height())
    return fail(ErrorCode::kDamaged, "its image is none");
  const StillMaskPtr still = still_mask_of(image->width(), image->height(), record.still_mask);
  return expected_points(map, **camera, *pose, *prepare_images(image->view(), still), still, kMostPoints,
                         options);
}

}  // namespace cairn
