// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "common/base/result.h"
#include "server/keys/identity.h"

namespace cairn {

/// Who has keys of the site that a server serves, as the register in its security folder says at this moment:
/// whom it turns away although the certificate is still good, and what an operator may do. It goes by names:
/// on the wire an identity is its partition. So no name is issued again while a certificate that was revoked
/// with it is still valid. One thread.
class SiteKeys {
 public:
  SiteKeys() = default;  ///< of an open site: nobody has keys, and nobody is turned away
  /// Errors: kNotFound, kIo, kDamaged; they name the register.
  [[nodiscard]] static Result<SiteKeys> read(const std::filesystem::path& security_folder);

  [[nodiscard]] bool is_secured() const { return !register_file_.empty(); }
  [[nodiscard]] bool is_revoked(IdentityRole role, std::string_view name) const;
  /// The names of that role whose keys were revoked.
  [[nodiscard]] std::set<std::string> revoked(IdentityRole role) const;
  /// Nothing: the register knows no such operator.
  [[nodiscard]] std::optional<Duty> duty_of(const std::string& operator_name) const;
  /// Who wears the camera of that client; empty: nobody, or the register knows no such client.
  [[nodiscard]] std::string wearer_of(const std::string& client) const;

  /// The clients that have keys, and the groups that these name.
  [[nodiscard]] std::map<std::string, std::set<std::string>> groups_of_clients() const;

  /// Reads the register again if its file is another than before, which costs a look at its name only.
  /// Returns true if the register says something else now. After an error, which it repeats until the file is
  /// good, all stays as it was.
  [[nodiscard]] Result<bool> look();

 private:
  struct Version {
    uint64_t inode = 0;
    int64_t changed_at = 0;  ///< [ns]
    int64_t bytes = 0;
    bool operator==(const Version&) const = default;
  };
  [[nodiscard]] std::optional<Version> version_now() const;

  std::filesystem::path register_file_;
  std::optional<Version> version_;  ///< nothing: what there is could not be read
  Register identities_;
};

}  // namespace cairn
