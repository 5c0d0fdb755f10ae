// SPDX-License-Identifier: Apache-2.0
#include "server/service/client.h"

#include <algorithm>

namespace cairn {

wire::OfferOutcome notice_to_process(const std::string& reason) {
  wire::OfferOutcome notice;
  notice.decision = wire::OfferDecision::kNoRight;
  notice.reason = reason;
  return notice;
}

std::optional<CameraPrior> AnnouncedCamera::prior_of(const CameraVersion& version) const {
  if (!prior) return std::nullopt;
  return CameraPrior{version, {prior->focal_sigma, prior->k1_sigma}};
}

Status CameraList::put(wire::PeerId process, const wire::CameraMessage& message, MonotonicTime now) {
  Process* const from = let_in(process, now);
  if (from == nullptr)
    return fail(ErrorCode::kRefused, "too many processes announce cameras under this name");
  if (!from->announcements.take(now))
    return fail(ErrorCode::kRefused, "announced too often: the server takes " + std::to_string(kPerSecond) +
                                         " a second of one process");
  Cameras& cameras = from->cameras;
  if (!cameras.contains(message.camera) && cameras.size() >= kMaxCameras) {
    return fail(ErrorCode::kRefused, "one camera too many");
  }
  Result<CameraPtr> camera = make_camera(message.parameters);
  if (!camera) return tl::unexpected(camera.error());
  std::optional<IntrinsicsPrior> prior;
  if (!message.frozen && !message.sigma.empty()) {
    prior = intrinsics_prior(message.parameters, message.sigma);
    if (!prior) return fail(ErrorCode::kRefused, "no camera that could be calibrated");
  }
  auto& versions = cameras[message.camera];
  const auto [known, is_new] =
      versions.try_emplace(message.version, AnnouncedCamera{*camera, std::move(prior)});
  if (!is_new && known->second.camera->parameters() != message.parameters) {
    return fail(ErrorCode::kRefused, "its version " + std::to_string(message.version) + " was another");
  }
  while (versions.size() > kVersionsKept) versions.erase(versions.begin());
  return {};
}

CameraList::Process* CameraList::let_in(wire::PeerId process, MonotonicTime now) {
  const auto known = std::find_if(processes_.begin(), processes_.end(),
                                  [&](const Process& entry) { return entry.id == process; });
  if (known != processes_.end()) return &*known;
  if (!newcomers_.take(now)) return nullptr;
  if (processes_.size() >= kMaxProcesses) {
    processes_.erase(processes_.begin() + (processes_.front().id == holder_ ? 1 : 0));
  }
  return &processes_.emplace_back(Process{process, {}});
}

const AnnouncedCamera* CameraList::find(uint32_t camera, uint32_t version) const {
  const auto process = std::find_if(processes_.begin(), processes_.end(),
                                    [&](const Process& entry) { return entry.id == holder_; });
  if (process == processes_.end()) return nullptr;
  const auto versions = process->cameras.find(camera);
  if (versions == process->cameras.end()) return nullptr;
  const auto found = versions->second.find(version);
  return found == versions->second.end() ? nullptr : &found->second;
}

}  // namespace cairn
