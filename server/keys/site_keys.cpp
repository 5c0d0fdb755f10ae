// SPDX-License-Identifier: Apache-2.0
#include "server/keys/site_keys.h"

#include <sys/stat.h>

#include <utility>

namespace cairn {

Result<SiteKeys> SiteKeys::read(const std::filesystem::path& security_folder) {
  SiteKeys keys;
  keys.register_file_ = security_folder / kRegisterFile;
  if (const auto read = keys.look(); !read) return tl::unexpected(read.error());
  return keys;
}

bool SiteKeys::is_revoked(IdentityRole role, std::string_view name) const {
  if (!is_secured()) return false;
  const auto known = identities_.find({role, std::string(name)});
  return known != identities_.end() && known->second.revoked;
}

std::set<std::string> SiteKeys::revoked(IdentityRole role) const {
  std::set<std::string> names;
  for (const auto& [key, identity] : identities_)
    if (key.first == role && identity.revoked) names.insert(key.second);
  return names;
}

std::optional<Duty> SiteKeys::duty_of(const std::string& operator_name) const {
  const auto known = identities_.find({IdentityRole::kOperator, operator_name});
  return known == identities_.end() ? std::nullopt : std::optional(known->second.duty);
}

std::string SiteKeys::wearer_of(const std::string& client) const {
  const auto known = identities_.find({IdentityRole::kClient, client});
  return known == identities_.end() ? std::string() : known->second.wearer;
}

std::map<std::string, std::set<std::string>> SiteKeys::groups_of_clients() const {
  std::map<std::string, std::set<std::string>> groups;
  for (const auto& [key, identity] : identities_) {
    if (identity.role == IdentityRole::kClient && !identity.revoked) groups[identity.name] = identity.groups;
  }
  return groups;
}

std::optional<SiteKeys::Version> SiteKeys::version_now() const {
  struct stat status {};
  if (stat(register_file_.c_str(), &status) != 0) return std::nullopt;
  return Version{status.st_ino, status.st_mtim.tv_sec * 1'000'000'000 + status.st_mtim.tv_nsec,
                 status.st_size};
}

Result<bool> SiteKeys::look() {
  if (!is_secured()) return false;
  const auto version = version_now();
  if (version && version == version_) return false;
  auto identities = read_register(register_file_);
  if (!identities) {
    version_.reset();
    return tl::unexpected(identities.error());
  }
  version_ = version;
  return std::exchange(identities_, *std::move(identities)) != identities_;
}

}  // namespace cairn
