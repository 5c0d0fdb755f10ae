// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "common/base/result.h"
#include "common/base/time.h"
#include "common/wire/participant.h"

namespace cairn::wire {

/// A security folder, as `cairnctl keys issue` leaves it and `--security` takes it.
struct Security {
  std::filesystem::path folder;  ///< absolute
  std::string role;              ///< client, server, operator or rig
  std::string name;              ///< by which the partitions go that it may use
  std::string tag;               ///< of the site; who does not know it draws no answer
  std::string authority;         ///< the fingerprint of the one that signs the site's identities
  Timestamp expires;
};

/// Reads and checks a folder before anybody joins with it: all files are there and belong together, the key
/// is for its owner only, it has neither expired nor been revoked. Error kConfiguration names the file and
/// what to do.
[[nodiscard]] Result<Security> read_security(const std::filesystem::path& folder, Timestamp now);
[[nodiscard]] Result<Security> read_security(const std::filesystem::path& folder);  ///< at this moment

/// The help of the option --security, which takes a DIR, in every program.
inline constexpr const char* kSecurityHelp =
    "security folder that `cairnctl keys issue` made for this program, of a secured site [an open site]";

/// The name in a security folder (read_security()), for a program of this role that is called `wanted`;
/// empty: it is called as its keys are. Errors: kConfiguration (they are of another role), kUsage (they are
/// somebody else's), those of read_security().
[[nodiscard]] Result<std::string> secured_name(const std::string& folder, std::string_view role,
                                               const std::string& wanted);

}  // namespace cairn::wire
