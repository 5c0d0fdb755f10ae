// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "server/service/label_registry.h"
#include "server/service/sessions.h"

namespace cairn {

/// Labels: takes what people ask for to the store and to all who read the map. Used from the service's
/// thread.
class Labels {
 public:
  using Done = std::function<void(const LabelRegistry::Judgement& judgement)>;

  Labels(const ServiceContext& context, Clients& clients, const Sessions& sessions, ServedMaps& maps)
      : context_(context), clients_(clients), sessions_(sessions), maps_(maps) {}
  Labels(const Labels&) = delete;
  Labels& operator=(const Labels&) = delete;

  /// Takes a request of the process that holds the client's name; those of others are passed over.
  void take(const Principal& who, const wire::ClientRequest& request);
  /// Adds, renames or removes a label. `done` is called when the change is durable or refused; without a
  /// store, at once. Precondition: the label is not busy. `decision`: kept along with the change.
  void change(const wire::ClientRequest& request, const Principal& author,
              std::optional<DecisionRecord> decision, const Done& done);
  /// Tells all who read the map a label as it is now, or that it is gone.
  void tell(MapId map, const MapEntry& entry, LabelId id);
  /// Moves the labels with the keyframes, as the map has another revision.
  void follow(MapId map, MapEntry& entry);

 private:
  /// Notes what came of a request in the audit log.
  void note(const std::string& client_name, const wire::ClientRequest& request,
            const LabelRegistry::Judgement& judgement, const std::string& old_text);
  void on_decided(const std::string& client_name, const wire::ClientRequest& request,
                  const LabelRegistry::Judgement& judgement);
  /// Why nothing comes of a request; nothing: it is to be judged.
  [[nodiscard]] std::optional<LabelRegistry::Judgement> refuse(const wire::ClientRequest& request,
                                                               const Principal& author,
                                                               const MapEntry* entry) const;
  void keep(MapId map, const LabelRegistry::Judgement& judged, std::optional<DecisionRecord> decision,
            std::function<void(const Status& kept)> settle);

  const ServiceContext& context_;
  Clients& clients_;
  const Sessions& sessions_;
  ServedMaps& maps_;
};

}  // namespace cairn
