// SPDX-License-Identifier: Apache-2.0
#include "server/service/client.h"

#include "common/wire/partition.h"

namespace cairn {

Result<ClientWriters> ClientWriters::create(const wire::Participant& participant, const std::string& client) {
  auto writers = wire::create_all<wire::Writer<wire::ServerStatus>, wire::Writer<wire::MapInfo>,
                                  wire::Writer<wire::SeedVerdict>, wire::Writer<wire::OfferVerdict>>(
      participant, wire::client_partition(client));
  if (!writers) return tl::unexpected(writers.error());
  auto& [status, maps, seeds, offers] = *writers;
  return ClientWriters{std::move(status), std::move(maps), std::move(seeds), std::move(offers)};
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
