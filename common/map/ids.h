// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <compare>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "common/base/result.h"

namespace cairn {

/// A counter that is an identity within its scope. `Tag` keeps the kinds apart; 0 means "none".
template <typename Tag>
struct CounterId {
  uint64_t value = 0;
  auto operator<=>(const CounterId&) const = default;
  [[nodiscard]] explicit operator bool() const { return value != 0; }
};

using KeyframeId = CounterId<struct KeyframeTag>;  ///< unique within a map, from 1, never reused
using PointId = CounterId<struct PointTag>;        ///< unique within a map, from 1, never reused, ascending
using Revision = CounterId<struct RevisionTag>;    ///< of a map; grows by one with every published change
using Epoch = CounterId<struct EpochTag>;  ///< of a map; block layouts and revisions never mix across it
using SessionId = CounterId<struct SessionTag>;  ///< random, one per run of a client (kept with its spool)
using LabelId = CounterId<struct LabelTag>;      ///< unique within a map, from 1
using TrailId = CounterId<struct TrailTag>;      ///< a trail of the two-view start, unique within a client
using CandidateId = CounterId<struct CandidateTag>;  ///< of a PointCandidate, unique within a session

/// A global identity of 16 bytes, printed as 32 hex digits. All zero means "none".
template <typename Tag>
struct GlobalId {
  std::array<uint8_t, 16> bytes{};
  auto operator<=>(const GlobalId&) const = default;
  [[nodiscard]] explicit operator bool() const { return *this != GlobalId{}; }
};

using MapId = GlobalId<struct MapTag>;
using ClientId = GlobalId<struct ClientTag>;
using ServerId = GlobalId<struct ServerTag>;

/// 32 lower-case hex digits.
[[nodiscard]] std::string to_hex(const std::array<uint8_t, 16>& bytes);
/// Inverse of to_hex; an error that quotes the text otherwise.
[[nodiscard]] Result<std::array<uint8_t, 16>> from_hex(std::string_view text);

inline constexpr size_t kMaxNameLength = 32;  ///< of is_valid_name()
/// Whether `name` may name a client, rig or operator: [a-z0-9-]{1,32}.
[[nodiscard]] bool is_valid_name(std::string_view name);
/// UUIDv5 (RFC 4122, SHA-1) of a client name, in Cairn's own name space: equal names, equal ids, on every
/// machine.
[[nodiscard]] ClientId client_id_from_name(std::string_view name);

}  // namespace cairn

template <typename Tag>
struct std::hash<cairn::CounterId<Tag>> {
  size_t operator()(const cairn::CounterId<Tag>& id) const noexcept {
    return std::hash<uint64_t>()(id.value);
  }
};
template <typename Tag>
struct std::hash<cairn::GlobalId<Tag>> {
  size_t operator()(const cairn::GlobalId<Tag>& id) const noexcept {
    return std::hash<std::string_view>()({reinterpret_cast<const char*>(id.bytes.data()), id.bytes.size()});
  }
};
