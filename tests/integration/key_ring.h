// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <filesystem>
#include <stdexcept>
#include <string>

#include "common/base/time.h"
#include "common/io/test_directory.h"
#include "server/keys/keystore.h"

namespace cairn::testing {

/// The keys of a secured site, which the product makes.
class KeyRing {
 public:
  KeyRing() {
    if (const Status made = Keystore::init(folder(), wall_clock_now()); !made)
      throw std::runtime_error(made.error().message);
  }

  /// The security folder of an identity, which is made when it is asked for first.
  std::filesystem::path of(IdentityRole role, const std::string& name,
                           std::chrono::seconds good_for = std::chrono::hours(24),
                           Duty duty = Duty::kAdminister) {
    auto keys = Keystore::open(folder()).value();
    if (keys.identities().contains({role, name})) return keys.security_folder(role, name);
    Identity wanted;
    wanted.role = role;
    wanted.name = name;
    if (role == IdentityRole::kOperator) wanted.duty = duty;
    return keys.issue(wanted, good_for, wall_clock_now()).value();
  }
  /// In the same folder.
  void renew(IdentityRole role, const std::string& name) {
    (void)Keystore::open(folder())
        .value()
        .renew(role, name, std::chrono::hours(24), wall_clock_now())
        .value();
  }
  /// As when a device is lost: it has a copy of what goes here.
  void revoke(IdentityRole role, const std::string& name) {
    if (const Status done = Keystore::open(folder()).value().revoke(role, name, wall_clock_now()); !done)
      throw std::runtime_error(done.error().message);
  }
  /// What was copied to a device.
  std::filesystem::path copied(const std::filesystem::path& security) const {
    const auto copy = directory_.path() / ("device-" + security.filename().string());
    std::filesystem::copy(security, copy);
    return copy;
  }

 private:
  [[nodiscard]] std::filesystem::path folder() const { return directory_.path() / "keys"; }
  const TestDirectory directory_;
};

}  // namespace cairn::testing
