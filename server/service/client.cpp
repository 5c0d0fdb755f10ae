// SPDX-License-Identifier: Apache-2.0
#include "server/service/client.h"

#include "common/wire/partition.h"

namespace cairn {

Result<ClientWriters> ClientWriters::create(const wire::Participant& participant, const std::string& client) {
  const std::string partition = wire::client_partition(client);
  auto status = wire::Writer<wire::ServerStatus>::create(participant, partition);
  if (!status) return tl::unexpected(status.error());
  auto maps = wire::Writer<wire::MapInfo>::create(participant, partition);
  if (!maps) return tl::unexpected(maps.error());
  auto seeds = wire::Writer<wire::SeedVerdict>::create(participant, partition);
  if (!seeds) return tl::unexpected(seeds.error());
  auto offers = wire::Writer<wire::OfferVerdict>::create(participant, partition);
  if (!offers) return tl::unexpected(offers.error());
  auto places = wire::Writer<wire::RelocAnswer>::create(participant, partition);
  if (!places) return tl::unexpected(places.error());
  return ClientWriters{std::move(*status), std::move(*maps), std::move(*seeds), std::move(*offers),
                       std::move(*places)};
}

bool CameraList::put(const wire::CameraMessage& message) {
  if (!cameras_.contains(message.camera) && cameras_.size() >= kMaxCameras) return false;
  Result<CameraPtr> camera = make_camera(message.parameters);
  if (!camera) return false;
  auto& versions = cameras_[message.camera];
  versions.insert_or_assign(message.version, std::move(*camera));
  while (versions.size() > kVersionsKept) versions.erase(versions.begin());
  return true;
}

CameraPtr CameraList::find(uint32_t camera, uint32_t version) const {
  const auto versions = cameras_.find(camera);
  if (versions == cameras_.end()) return nullptr;
  const auto found = versions->second.find(version);
  return found == versions->second.end() ? nullptr : found->second;
}

}  // namespace cairn
