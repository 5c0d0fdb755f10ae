// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <variant>

#include "server/service/map_service.h"

namespace cairn::simulation {

struct LabelRemoved {
  MapId map;
  LabelId label;
};
/// What comes into the partitions of one client: what it is told, and the maps that it follows.
using Delivery = std::variant<ClientEvent, MapSnapshotPtr, wire::LabelMessage, LabelRemoved>;

/// The map service in the same process: what would be written to a client's partitions is handed to a
/// function, by the rules of server/endpoint. Used from one thread.
class InProcess : public ServiceOutput {
 public:
  struct Listener {
    std::function<void(const std::string& client, const Delivery& delivery)> delivered;
    std::function<void(const std::string& operator_name, const wire::AdminReply& reply)> answered;
    std::function<void(MapId map, const MapSnapshotPtr& newest)> revised;  ///< whoever follows it
  };
  explicit InProcess(Listener listener) : listener_(std::move(listener)) {}
  /// Sets the service, which outlives all calls. To be called before anything of what follows.
  void serve(MapService& service) { service_ = &service; }

  void connect(const std::string& client);
  void disconnect(const std::string& client);
  /// The client has readers for the map, and has them no more.
  void want(const std::string& client, MapId map);
  void want_no_more(const std::string& client, MapId map);

  [[nodiscard]] Status tell(const std::string& client, const ClientEvent& event) override;
  [[nodiscard]] Status answer(const std::string& operator_name, const wire::AdminReply& reply) override;
  void revised(MapId map, const MapSnapshotPtr& newest) override;
  void labelled(const wire::LabelMessage& label) override;
  void label_removed(MapId map, LabelId label) override;
  void ended(MapId map) override;

 private:
  struct Link {
    bool is_connected = false;
    std::set<MapId> wanted;
    std::set<MapId> fed;  ///< of those
  };
  void open_feeds(const std::string& client, Link* link);

  const Listener listener_;
  MapService* service_ = nullptr;
  std::map<std::string, Link> links_;
};

}  // namespace cairn::simulation
