// SPDX-License-Identifier: Apache-2.0
#include "server/service/proposal_rule.h"

namespace cairn {

bool takes_proposals(const ServiceContext& context, const Client& client, MapId map, const MapEntry& entry) {
  return context.store != nullptr && entry.runner != nullptr && !entry.rolling_back && !entry.leaving &&
         context.access().may_propose(client.principal(), map);
}

std::string why_aside(const wire::KeyframeOffer& offer, const MapEntry& entry, const Ruling& ruling) {
  if (offer.as_proposal) return "its tracker only reads (--role reader)";
  if (ruling.right < Right::kAdd) return ruling.reason;
  // The map maker judges by the pose that it finds itself; what lies clearly outside need not wait for that.
  const KeyframePose* reference = offer.reference_command == 0 && offer.epoch == entry.snapshot->epoch
                                      ? entry.snapshot->find(offer.reference)
                                      : nullptr;
  if (!ruling.extent || reference == nullptr) return {};
  const Eigen::Vector3d center = (offer.camera_from_reference * reference->camera_from_map).center();
  return contains(*ruling.extent, center) ? std::string() : outside(*ruling.extent, "its camera", center);
}

}  // namespace cairn
