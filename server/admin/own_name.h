// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "common/base/result.h"
#include "common/wire/network_path.h"
#include "common/wire/participant.h"

namespace cairn {

/// Who runs this program, as the operating system knows them: who has become another by sudo goes by the name
/// that they had before. [a-z0-9-]{1,20}
[[nodiscard]] std::string person_name();

/// "USER-PROCESS", a name that no other process of this machine has: an operator's, or a commander's.
[[nodiscard]] std::string own_name();

/// The name of an operator: that of its keys in a secured site, own_name() in an open one (`security` is
/// empty). Errors: those of wire::secured_name().
[[nodiscard]] Result<std::string> operator_name(const std::string& security);

/// How an operator's program joins, by AdminClientOptions or RigClientOptions, with a peer on `host`; the
/// role is for the caller to say. Error kUsage: no such domain.
template <typename Options>
[[nodiscard]] Result<wire::ParticipantOptions> joining_options(const Options& options,
                                                               const std::string& host) {
  if (options.domain < 0 || options.domain > static_cast<int>(wire::kMaxDomain))
    return fail(ErrorCode::kUsage, "domain " + std::to_string(options.domain) + ": expected 0 to " +
                                       std::to_string(wire::kMaxDomain));
  wire::ParticipantOptions joining;
  joining.security = options.security;
  joining.domain = static_cast<uint32_t>(options.domain);
  joining.server_host = host;
  joining.profile = options.profile.empty() ? wire::default_profile(host) : options.profile;
  joining.listen = options.listen;
  return joining;
}

}  // namespace cairn
