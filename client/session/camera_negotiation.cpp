// SPDX-License-Identifier: Apache-2.0
#include "client/session/camera_negotiation.h"

#include <algorithm>
#include <tuple>
#include <utility>

#include "common/geometry/camera_guess.h"

namespace cairn {
namespace {

/// A camera that is self-calibrated is known to the maps by the client's name and this number. Images of
/// another size come from another camera.
uint32_t number_by_size(const Camera& camera) {
  return static_cast<uint32_t>(camera.width()) << 16 | static_cast<uint32_t>(camera.height());
}

}  // namespace

CameraNegotiation::CameraNegotiation(ClientId client, const std::vector<double>& sigma,
                                     const CameraPtr& camera)
    : first_(camera) {
  in_use_.client = client;
  in_use_.parameters = camera->parameters();
  in_use_.sigma = sigma;
  in_use_.frozen = sigma.empty();
  if (sigma.empty()) return;
  in_use_.camera = number_by_size(*camera);
  first_focal_sigma_ = sigma.at(0) / in_use_.parameters.values.at(0);
  first_k1_sigma_ = sigma.at(4);
}

bool CameraNegotiation::take(const wire::CameraEstimate& estimate) {
  const bool is_exact = first_focal_sigma_ == 0;
  if (is_exact || estimate.client != in_use_.client || estimate.camera != in_use_.camera) return true;
  const CameraParameters& ours = in_use_.parameters;
  const CameraParameters& theirs = estimate.parameters;
  const auto prior = intrinsics_prior(theirs, estimate.sigma);
  const auto camera = make_camera(theirs);
  if (!prior || !camera || theirs.width != ours.width || theirs.height != ours.height) {
    unsound_.insert(estimate.map);
    return !told_unsound_.insert(estimate.map).second;
  }
  unsound_.erase(estimate.map);
  auto& kept = found_[estimate.map];
  if (!kept.empty() &&
      std::tie(estimate.epoch, estimate.version) <= std::tie(kept.back().epoch, kept.back().update.version))
    return true;  // a repetition, or a late word of a server that has died
  if (kept.size() == kEstimatesKept) kept.pop_front();
  kept.push_back({estimate.epoch,
                  {estimate.version, *camera, prior->focal_sigma, prior->k1_sigma, estimate.frozen,
                   estimate.cannot_be_known}});
  return true;
}

void CameraNegotiation::forget(const wire::CameraEstimate& key) {
  if (key.client != in_use_.client || key.camera != in_use_.camera) return;
  found_.erase(key.map);
  unsound_.erase(key.map);
}

bool CameraNegotiation::has_values_of(const MapSnapshot& map) const {
  const auto other = other_values_of(map);
  return !other || find(*other) != nullptr;
}

bool CameraNegotiation::is_self_calibrated_by(const MapSnapshot& own) const {
  return in_use_.frozen || ours_in(own) != nullptr;
}

std::optional<CameraUpdate> CameraNegotiation::use_values_of(const MapSnapshot& map) {
  const auto other = other_values_of(map);
  const MapEstimate* there = other ? find(*other) : nullptr;
  if (there == nullptr) return std::nullopt;
  const Source source{map.map, there->epoch, there->update.version};
  if (source == source_) return std::nullopt;
  return use(source, there->update);
}

std::optional<CameraUpdate> CameraNegotiation::use_first_values() {
  if (!source_ || in_use_.frozen) return std::nullopt;
  return use(std::nullopt, {0, first_, first_focal_sigma_, first_k1_sigma_, false, false});
}

/// Takes values into use. While the camera is not known, the sigma stays that of the beginning: the next map
/// would take what a map believes so far for what was known before it.
CameraUpdate CameraNegotiation::use(const std::optional<Source>& source, CameraUpdate update) {
  source_ = source;
  ++in_use_.version;
  in_use_.parameters = update.camera->parameters();
  in_use_.sigma =
      sigma_of_values({in_use_.parameters, update.frozen ? update.focal_sigma : first_focal_sigma_,
                       update.frozen ? update.k1_sigma : first_k1_sigma_});
  in_use_.frozen = update.frozen;
  announcing_ = Announcing::kDue;
  return update;
}

std::optional<wire::CameraMessage> CameraNegotiation::next_announcement() {
  if (announcing_ != Announcing::kDue) return std::nullopt;
  announcing_ = Announcing::kUnderWay;
  return in_use_;
}

void CameraNegotiation::written(bool is_written) {
  // Other values may have come into use while these were being written.
  if (announcing_ == Announcing::kUnderWay)
    announcing_ = is_written ? Announcing::kDone : Announcing::kFailed;
}

void CameraNegotiation::announce_again() {
  announcing_ = Announcing::kDue;
}

void CameraNegotiation::try_again() {
  if (announcing_ == Announcing::kFailed) announcing_ = Announcing::kDue;
}

const CameraVersion* CameraNegotiation::ours_in(const MapSnapshot& map) const {
  const auto named = std::ranges::find_if(map.cameras, [&](const CameraVersion& version) {
    return version.client == in_use_.client && version.camera == in_use_.camera;
  });
  return named == map.cameras.end() ? nullptr : &*named;
}

std::optional<CameraNegotiation::Source> CameraNegotiation::other_values_of(const MapSnapshot& map) const {
  const CameraVersion* named = in_use_.frozen ? nullptr : ours_in(map);
  if (named == nullptr) return std::nullopt;
  const Source source{map.map, map.epoch, named->version};
  return source == source_ ? std::nullopt : std::optional(source);
}

const CameraNegotiation::MapEstimate* CameraNegotiation::find(const Source& source) const {
  const auto found = found_.find(source.map);
  if (found == found_.end()) return nullptr;
  const auto is_no_earlier = [&](const MapEstimate& estimate) {
    return estimate.epoch > source.epoch ||
           (estimate.epoch == source.epoch && estimate.update.version >= source.version);
  };
  const auto there = std::ranges::find_if(found->second, is_no_earlier);
  return there == found->second.end() ? nullptr : &*there;
}

}  // namespace cairn
