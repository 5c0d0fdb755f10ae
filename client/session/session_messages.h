// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "client/session/session_core.h"
#include "common/wire/messages.h"

namespace cairn {

/// The part that all commands of a session share.
struct CommandHeader {
  ClientId client;
  bool lockstep = false;
  bool as_proposals = false;   ///< keyframes: who only reads offers no others
  wire::CameraMessage camera;  ///< the one announced last
  wire::ImageEncoding encoding = wire::ImageEncoding::kRaw;
};

/// Commands as they go out. Images are encoded here, which takes milliseconds. Pure; thread-safe.
[[nodiscard]] wire::MapSeed make_message(const SeedSlot::Sendable& sendable, const CommandHeader& header);
[[nodiscard]] wire::KeyframeOffer make_message(const SessionCore::Offer& offer, const CommandHeader& header);
[[nodiscard]] wire::RelocQuery make_message(const QuerySlot::Sendable& sendable, const CommandHeader& header);
[[nodiscard]] wire::ClientRequest make_message(const RequestSpool::Sendable& sendable,
                                               const CommandHeader& header);

}  // namespace cairn
