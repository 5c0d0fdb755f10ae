// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <span>

#include "server/store/proposal.h"
#include "server/store/row_codec.h"

/// The blobs of table `proposals`. As row_codec.h. Pure.
namespace cairn {

[[nodiscard]] Blob encode_proposal(const ProposalRecord& proposal);
[[nodiscard]] std::optional<ProposalRecord> decode_proposal(int64_t id, std::span<const uint8_t> row);

}  // namespace cairn
