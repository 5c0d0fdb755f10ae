// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "server/store/proposal.h"
#include "server/store/row_codec.h"

/// The blobs of table `proposals`. As row_codec.h. Pure.
namespace cairn {

/// No map has had so many: a number beyond was not written by us, and others must follow it.
constexpr uint64_t kMostProposalNumber = uint64_t{1} << 48;

[[nodiscard]] Blob encode_proposal(const ProposalRecord& proposal);
[[nodiscard]] std::optional<ProposalRecord> decode_proposal(int64_t id, std::span<const uint8_t> row);

}  // namespace cairn
