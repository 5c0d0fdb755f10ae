// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>
#include <cstdint>
#include <string>
#include <utility>

#include "server/access/duty.h"

namespace cairn {

/// Who asks for something, and how that is known. Every request to the map service carries one; adapters make
/// it of what they know of their peer, never of what a message says.
struct Principal {
  enum class Kind : uint8_t {
    kClient,    ///< a tracker, by its name
    kOperator,  ///< who runs the server
  };
  enum class Proof : uint8_t {
    kClaimed,    ///< the partition it speaks in, on a site that lets anybody choose his
    kProven,     ///< the same where DDS Security lets nobody else speak there
    kInProcess,  ///< part of this program
  };
  Kind kind = Kind::kClient;
  std::string name;
  Proof proof = Proof::kClaimed;
  Duty duty = Duty::kWatch;  ///< of an operator
  auto operator<=>(const Principal&) const = default;
};

[[nodiscard]] inline Principal client_principal(std::string name,
                                                Principal::Proof proof = Principal::Proof::kClaimed) {
  return {Principal::Kind::kClient, std::move(name), proof};
}

[[nodiscard]] inline Principal operator_principal(std::string name, Principal::Proof proof, Duty duty) {
  return {Principal::Kind::kOperator, std::move(name), proof, duty};
}

}  // namespace cairn
