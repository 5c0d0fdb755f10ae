// SPDX-License-Identifier: Apache-2.0
#include "common/wire/participant.h"

#include "common/wire/internal/context.h"

namespace cairn::wire {

Result<Participant> Participant::create(const ParticipantOptions& options) {
  auto context = internal::Context::create(options);
  if (!context) return tl::unexpected(context.error());
  return Participant(*std::move(context));
}

Traffic Participant::traffic() const {
  return {context_->bytes_sent, context_->bytes_received};
}

std::optional<Timestamp> Participant::good_until() const {
  return context_->good_until();
}

const NetworkPath& Participant::path() const {
  return context_->path();
}

}  // namespace cairn::wire
