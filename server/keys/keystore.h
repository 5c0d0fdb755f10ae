// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <filesystem>
#include <string>
#include <vector>

#include "common/base/file_descriptor.h"
#include "server/keys/authority.h"
#include "server/keys/identity.h"

namespace cairn {

/// The keys of a site, in a folder that only its operator can read: two authorities, the register, and for
/// each identity a security folder that is copied to its device whole. Each change is there whole or not at
/// all; of two processes that change it, one waits. The clock is handed in.
class Keystore {
 public:
  /// Makes `folder` with new authorities. Errors: kRefused (something is there already), kIo.
  [[nodiscard]] static Status init(const std::filesystem::path& folder, Timestamp now);
  /// Waits until nobody else has it. Errors: kNotFound (no keys there; says how to make some), kDamaged, kIo.
  [[nodiscard]] static Result<Keystore> open(const std::filesystem::path& folder);

  /// A name that is new, as `wanted` says; its issues are not looked at. The path of its security folder.
  /// Errors: kUsage (name, or what its role has not), kRefused (there is one of that name already; revoked
  /// ones block theirs until what they hold has expired), kConfiguration (an authority that is missing or has
  /// expired), kIo.
  [[nodiscard]] Result<std::filesystem::path> issue(const Identity& wanted, std::chrono::seconds valid_for,
                                                    Timestamp now);
  /// New key, certificate and permissions in the place of those that were made before. Errors: kNotFound,
  /// kRefused (revoked), and those of issue().
  [[nodiscard]] Result<std::filesystem::path> renew(IdentityRole role, const std::string& name,
                                                    std::chrono::seconds valid_for, Timestamp now);
  /// Puts it on the list that the server reads, and its certificates on the one that the middleware reads;
  /// its security folder goes. Errors: kNotFound, kConfiguration, kIo.
  [[nodiscard]] Status revoke(IdentityRole role, const std::string& name, Timestamp now);

  [[nodiscard]] const Register& identities() const { return identities_; }
  [[nodiscard]] std::filesystem::path security_folder(IdentityRole role, const std::string& name) const;

 private:
  Keystore(std::filesystem::path folder, FileDescriptor lock, Register identities);
  /// `identity` with a new issue, in the register and as a folder.
  [[nodiscard]] Result<std::filesystem::path> make(Identity identity, std::chrono::seconds valid_for,
                                                   Timestamp now);
  [[nodiscard]] Status leave_folder(const Identity& identity, const KeyPair& keys, const KeyPair& documents,
                                    const Validity& validity) const;
  /// The register, first here and then where the servers read it; with what is revoked for the middleware.
  [[nodiscard]] Status save(Register changed, Timestamp now);
  [[nodiscard]] Result<KeyPair> authority(const char* name, Timestamp now) const;

  std::filesystem::path folder_;
  FileDescriptor lock_;  ///< of the folder
  Register identities_;
};

}  // namespace cairn
