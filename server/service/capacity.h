// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

#include "server/service/map_array.h"
#include "server/service/service_options.h"

namespace cairn {

/// Whether the server has room for more: each answer is why not, with the option that says so, and empty
/// where there is room. Used from the service's thread; the options and the maps outlive it.
class Capacity {
 public:
  Capacity(const MapServiceOptions& options, const MapArray& maps) : options_(options), maps_(maps) {}

  /// Why there is no room for another map.
  [[nodiscard]] std::string why_full() const;
  /// Why a client may make no more maps: it has made as many as one may.
  [[nodiscard]] std::string why_maker_is_full(const std::string& client) const;
  /// Why there is no room for another keyframe in a map.
  [[nodiscard]] std::string why_map_is_full(const MapEntry& entry) const;
  /// Why there is no memory for growth that takes `more` [bytes] at first.
  [[nodiscard]] std::string why_memory_is_full(size_t more = 0) const;
  /// Memory that is free [bytes].
  [[nodiscard]] size_t free_bytes() const;

 private:
  const MapServiceOptions& options_;
  const MapArray& maps_;
};

}  // namespace cairn
