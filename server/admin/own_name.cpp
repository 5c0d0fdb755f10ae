// SPDX-License-Identifier: Apache-2.0
#include "server/admin/own_name.h"

#include <unistd.h>

#include <cstdlib>

#include "common/wire/security.h"

namespace cairn {

std::string own_name() {
  const char* user = std::getenv("USER");
  std::string name;
  for (const char c : std::string(user != nullptr ? user : "operator").substr(0, 20)) {
    const bool plain = (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9');
    name += plain ? c : '-';
  }
  return name + "-" + std::to_string(getpid());
}

Result<std::string> operator_name(const std::string& security) {
  if (security.empty()) return own_name();
  auto name = wire::secured_name(security, "operator", "");
  if (!name) return fail(name.error().code, "--security " + name.error().message);
  return name;
}

}  // namespace cairn
