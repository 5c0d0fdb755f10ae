// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"
#include "server/access/duty.h"

/// Who has been given keys: the register of a site, which the server reads.
namespace cairn {

enum class IdentityRole : uint8_t { kClient, kServer, kOperator, kRig };
/// The word of the command line, of certificates and of the register: "client", "server", "operator", "rig".
[[nodiscard]] std::string_view to_string(IdentityRole role);
[[nodiscard]] Result<IdentityRole> parse_identity_role(std::string_view word);

/// The word of to_string(); error kUsage with the words that there are.
[[nodiscard]] Result<Duty> parse_duty(std::string_view word);

/// A certificate that was made.
struct Issue {
  std::string serial;  ///< hex digits
  Timestamp expires;
  bool operator==(const Issue&) const = default;
};

struct Identity {
  IdentityRole role = IdentityRole::kClient;
  std::string name;  ///< [a-z0-9-]{1,32}
  std::set<std::string> groups;
  std::string rig;                   ///< of a client whose camera it carries; may be empty
  std::string wearer;                ///< of a client; may be empty
  Duty duty = Duty::kWatch;          ///< of an operator
  std::vector<Issue> issues;         ///< the newest last
  std::optional<Timestamp> revoked;  ///< since when
  bool operator==(const Identity&) const = default;
};

/// Time up to which something that was issued to the identity is valid: until then nobody else is given its
/// name.
[[nodiscard]] inline Timestamp last_expiry(const Identity& identity) {
  Timestamp last;
  for (const Issue& issue : identity.issues) last = std::max(last, issue.expires);
  return last;
}

/// The register of a site: its identities, by role and name.
using Register = std::map<std::pair<IdentityRole, std::string>, Identity>;

/// Writes a register as JSON text, one line for each identity.
[[nodiscard]] std::string to_text(const Register& identities);
/// Reads a register from such text. Error kDamaged, with what is wrong; nothing is taken in part.
[[nodiscard]] Result<Register> parse_register(std::string_view text);
/// Reads the register in a file. Errors name the file.
[[nodiscard]] Result<Register> read_register(const std::filesystem::path& path);

/// The name of the register in a folder of keys, and in the security folder of a server.
inline constexpr std::string_view kRegisterFile = "identities.json";

}  // namespace cairn
