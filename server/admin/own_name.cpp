// SPDX-License-Identifier: Apache-2.0
#include "server/admin/own_name.h"

#include <pwd.h>
#include <unistd.h>

#include <cstdlib>

#include "common/wire/security.h"

namespace cairn {

std::string person_name() {
  const char* before_sudo = std::getenv("SUDO_USER");
  const passwd* account = getpwuid(getuid());
  std::string user = before_sudo != nullptr ? before_sudo : account != nullptr ? account->pw_name : "";
  if (user.empty()) user = "user-" + std::to_string(getuid());
  std::string name;
  for (const char c : user.substr(0, 20)) {
    const char small = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
    const bool plain = (small >= 'a' && small <= 'z') || (small >= '0' && small <= '9');
    name += plain ? small : '-';
  }
  return name;
}

std::string own_name() {
  return person_name() + "-" + std::to_string(getpid());
}

Result<std::string> operator_name(const std::string& security) {
  if (security.empty()) return own_name();
  auto name = wire::secured_name(security, "operator", "");
  if (!name) return fail(name.error().code, "--security " + name.error().message);
  return name;
}

}  // namespace cairn
