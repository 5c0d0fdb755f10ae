// SPDX-License-Identifier: Apache-2.0
#include "server/keys/keystore.h"

#include <fcntl.h>
#include <openssl/rand.h>
#include <sys/file.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

#include "common/base/utc.h"
#include "common/io/text.h"
#include "common/map/ids.h"
#include "server/keys/permissions.h"
#include "server/keys/whole_file.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;
using std::chrono::hours;

constexpr auto kAuthorityLife = hours(24 * 3650);
/// Devices whose clocks are behind by less than this are let in.
constexpr auto kClockTolerance = hours(1);
constexpr const char* kIdentities = "identity_ca";
constexpr const char* kDocuments = "permissions_ca";
constexpr const char* kRevocations = "crl.pem";

fs::path certificate_file(const fs::path& folder, const char* authority) {
  return folder / "public" / (std::string(authority) + ".cert.pem");
}
fs::path key_file(const fs::path& folder, const char* authority) {
  return folder / "private" / (std::string(authority) + ".key.pem");
}

/// The files of a folder, in their order. Stops at the first that fails.
struct NewFile {
  fs::path path;
  Result<std::string> content;
  mode_t mode = kPublicFile;
};
Status write_all(const std::vector<NewFile>& files) {
  for (const NewFile& file : files) {
    if (!file.content) return tl::unexpected(file.content.error());
    if (Status written = write_whole_file(file.path, *file.content, file.mode); !written) return written;
  }
  return {};
}

/// 128 random bits as hex digits: of a site, so that who does not know it draws no answer.
Result<std::string> random_tag() {
  std::array<uint8_t, 16> bytes{};
  if (RAND_bytes(bytes.data(), bytes.size()) != 1)
    return fail(ErrorCode::kInternal, "random numbers: " + crypto_error());
  return to_hex(bytes) + "\n";
}

tl::unexpected<Error> told_of_place(const fs::path& unfinished, const fs::path& place, Error error) {
  if (const size_t at = error.message.find(unfinished.string()); at != std::string::npos)
    error.message.replace(at, unfinished.string().size(), place.string());
  return tl::unexpected(std::move(error));
}

std::string called(IdentityRole role, const std::string& name) {
  return std::string(to_string(role)) + " " + in_quotes(name);
}

Status check_names(const Identity& wanted) {
  std::vector<std::string> names(wanted.groups.begin(), wanted.groups.end());
  names.push_back(wanted.name);
  for (const std::string* optional : {&wanted.rig, &wanted.wearer})
    if (!optional->empty()) names.push_back(*optional);
  for (const std::string& name : names) {
    if (!is_valid_name(name))
      return fail(ErrorCode::kUsage, in_quotes(name) + ": a name has 1 to 32 letters of a-z, 0-9 and -");
  }
  const bool has_client_things = !wanted.groups.empty() || !wanted.rig.empty() || !wanted.wearer.empty();
  if (has_client_things && wanted.role != IdentityRole::kClient)
    return fail(ErrorCode::kUsage, "groups, a rig and a wearer are of clients only");
  return {};
}

}  // namespace

Status Keystore::init(const fs::path& folder, Timestamp now) {
  std::error_code problem;
  if (fs::exists(folder, problem) && !fs::is_empty(folder, problem))
    return fail(ErrorCode::kRefused, folder.string() + ": something is there already, and stays as it is");
  const Validity validity{now + -kClockTolerance, now + kAuthorityLife};
  const auto identities = make_authority("cairn identities", Signs::kIdentities, validity);
  if (!identities) return tl::unexpected(identities.error());
  const auto documents = make_authority("cairn permissions", Signs::kDocuments, validity);
  if (!documents) return tl::unexpected(documents.error());
  auto unfinished = UnfinishedFolder::make_beside(folder);
  if (!unfinished) return tl::unexpected(unfinished.error());
  const fs::path& place = unfinished->path();
  for (const char* part : {"public", "private", "enclaves"}) {
    if (mkdir((place / part).c_str(), 0700) != 0)
      return fail(ErrorCode::kIo, cannot_be_written(folder / part));
  }
  const Status written = write_all({
      {certificate_file(place, kIdentities), to_pem(*identities->certificate)},
      {key_file(place, kIdentities), to_pem(*identities->key), kSecretFile},
      {certificate_file(place, kDocuments), to_pem(*documents->certificate)},
      {key_file(place, kDocuments), to_pem(*documents->key), kSecretFile},
      {place / "governance.p7s", sign_document(*documents, make_governance())},
      {place / "tag", random_tag(), kSecretFile},
      {place / kRevocations, make_revocations(*identities, {}, validity)},
      {place / kRegisterFile, to_text(Register{})},
  });
  if (!written) return told_of_place(place, folder, written.error());
  return unfinished->leave();
}

Keystore::Keystore(fs::path folder, FileDescriptor lock, Register identities)
    : folder_(std::move(folder)), lock_(std::move(lock)), identities_(std::move(identities)) {}

Result<Keystore> Keystore::open(const fs::path& folder) {
  FileDescriptor lock(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  std::error_code problem;
  if (lock.get() < 0 || !fs::exists(folder / kRegisterFile, problem)) {
    const std::string why = lock.get() < 0 && errno != ENOENT ? std::strerror(errno) : "no keys are there";
    return fail(ErrorCode::kNotFound,
                fs::absolute(folder, problem).lexically_normal().string() + ": " + why +
                    "; --keys DIR names the folder that has the keys of your site. Only who has no site yet "
                    "makes one, with `cairnctl keys init`");
  }
  while (flock(lock.get(), LOCK_EX) != 0) {
    if (errno != EINTR) return fail(ErrorCode::kIo, folder.string() + ": " + std::strerror(errno));
  }
  auto identities = read_register(folder / kRegisterFile);
  if (!identities) return tl::unexpected(identities.error());
  return Keystore(folder, std::move(lock), *std::move(identities));
}

fs::path Keystore::security_folder(IdentityRole role, const std::string& name) const {
  return folder_ / "enclaves" / to_string(role) / name;
}

Result<KeyPair> Keystore::authority(const char* name, Timestamp now) const {
  const fs::path path = certificate_file(folder_, name);
  auto certificate = read_certificate(path);
  if (!certificate) return tl::unexpected(certificate.error());
  auto key = read_private_key(key_file(folder_, name));
  if (!key) return tl::unexpected(key.error());
  if (!belongs_to(**key, **certificate))
    return fail(ErrorCode::kConfiguration,
                key_file(folder_, name).string() + ": not the key of " + path.string());
  if (const Timestamp expires = facts_of(**certificate).expires; expires <= now) {
    return fail(ErrorCode::kConfiguration,
                path.string() + ": has expired at " + to_utc(expires) +
                    "; `cairnctl keys init --keys NEW-FOLDER` makes new ones, for all devices");
  }
  return KeyPair{*std::move(key), *std::move(certificate)};
}

Result<fs::path> Keystore::issue(const Identity& wanted, std::chrono::seconds valid_for, Timestamp now) {
  if (Status names = check_names(wanted); !names) return tl::unexpected(names.error());
  const auto known = identities_.find({wanted.role, wanted.name});
  if (known == identities_.end()) return make(wanted, valid_for, now);
  const std::string who = called(wanted.role, wanted.name);
  if (!known->second.revoked) {
    return fail(ErrorCode::kRefused, who + " has keys already; `cairnctl keys renew " +
                                         std::string(to_string(wanted.role)) + " " + wanted.name +
                                         "` makes new ones");
  }
  // The server knows an identity by its name: it would let in whoever has the old keys as well.
  if (const Timestamp last = last_expiry(known->second); last > now) {
    return fail(ErrorCode::kRefused, who + " was revoked, and its keys are good until " + to_utc(last) +
                                         ": the name is free from then on; take another");
  }
  return make(wanted, valid_for, now);
}

Result<fs::path> Keystore::renew(IdentityRole role, const std::string& name, std::chrono::seconds valid_for,
                                 Timestamp now) {
  const auto known = identities_.find({role, name});
  if (known == identities_.end())
    return fail(ErrorCode::kNotFound, called(role, name) + " has no keys; `cairnctl keys issue` makes some");
  if (known->second.revoked)
    return fail(ErrorCode::kRefused, called(role, name) + " was revoked at " +
                                         to_utc(*known->second.revoked) + "; it is not renewed");
  Identity identity = known->second;
  std::erase_if(identity.issues, [now](const Issue& issue) { return issue.expires <= now; });
  return make(std::move(identity), valid_for, now);
}

Result<fs::path> Keystore::make(Identity identity, std::chrono::seconds valid_for, Timestamp now) {
  const auto identities = authority(kIdentities, now);
  if (!identities) return tl::unexpected(identities.error());
  const auto documents = authority(kDocuments, now);
  if (!documents) return tl::unexpected(documents.error());
  // Nothing is good for longer than its authority.
  const Timestamp last = facts_of(*identities->certificate).expires;
  const Validity validity{now + -kClockTolerance, std::min(now + valid_for, last)};
  const auto keys =
      make_identity(*identities, std::string(to_string(identity.role)), identity.name, validity);
  if (!keys) return tl::unexpected(keys.error());
  const CertificateFacts facts = facts_of(*keys->certificate);
  identity.revoked.reset();
  identity.issues.push_back({facts.serial, facts.expires});
  // First the register: what is not listed could not be revoked.
  Register changed = identities_;
  changed[{identity.role, identity.name}] = identity;
  if (Status saved = save(std::move(changed), now); !saved) return tl::unexpected(saved.error());
  if (Status left = leave_folder(identity, *keys, *documents, validity); !left)
    return tl::unexpected(left.error());
  return security_folder(identity.role, identity.name);
}

Status Keystore::leave_folder(const Identity& identity, const KeyPair& keys, const KeyPair& documents,
                              const Validity& validity) const {
  const fs::path place = security_folder(identity.role, identity.name);
  auto unfinished = UnfinishedFolder::make_beside(place);
  if (!unfinished) return tl::unexpected(unfinished.error());
  const fs::path& folder = unfinished->path();
  const std::string permissions = make_permissions(identity, subject_of(*keys.certificate), validity);
  std::vector<NewFile> files{
      {folder / "cert.pem", to_pem(*keys.certificate)},
      {folder / "key.pem", to_pem(*keys.key), kSecretFile},
      {folder / "permissions.p7s", sign_document(documents, permissions)},
      {folder / "governance.p7s", read_file(folder_ / "governance.p7s")},
      {folder / "identity_ca.cert.pem", read_file(certificate_file(folder_, kIdentities))},
      {folder / "permissions_ca.cert.pem", to_pem(*documents.certificate)},
      {folder / "tag", read_file(folder_ / "tag"), kSecretFile},
      {folder / kRevocations, read_file(folder_ / kRevocations)},
  };
  if (identity.role == IdentityRole::kServer) files.push_back({folder / kRegisterFile, to_text(identities_)});
  if (Status written = write_all(files); !written) return told_of_place(folder, place, written.error());
  return unfinished->leave();
}

Status Keystore::revoke(IdentityRole role, const std::string& name, Timestamp now) {
  const auto known = identities_.find({role, name});
  if (known == identities_.end())
    return fail(ErrorCode::kNotFound,
                called(role, name) + " has no keys; `cairnctl keys list` shows who has");
  Register changed = identities_;
  if (auto& revoked = changed[{role, name}].revoked; !revoked) revoked = now;
  if (Status saved = save(std::move(changed), now); !saved) return saved;
  std::error_code problem;
  fs::remove_all(security_folder(role, name), problem);
  if (problem)
    return fail(ErrorCode::kIo,
                security_folder(role, name).string() + ": cannot be removed: " + problem.message());
  return {};
}

Status Keystore::save(Register changed, Timestamp now) {
  const auto identities = authority(kIdentities, now);
  if (!identities) return tl::unexpected(identities.error());
  std::vector<RevokedSerial> revoked;
  for (const auto& [key, identity] : changed) {
    if (!identity.revoked) continue;
    for (const Issue& issue : identity.issues) revoked.push_back({issue.serial, *identity.revoked});
  }
  const Validity validity{now + -kClockTolerance, facts_of(*identities->certificate).expires};
  const auto revocations = make_revocations(*identities, revoked, validity);
  const std::string text = to_text(changed);
  std::vector<NewFile> files{{folder_ / kRegisterFile, text}, {folder_ / kRevocations, revocations}};
  for (const auto& [key, identity] : changed) {
    const fs::path folder = security_folder(key.first, key.second);
    std::error_code ignored;
    if (!fs::exists(folder, ignored)) continue;
    files.push_back({folder / kRevocations, revocations});
    if (key.first == IdentityRole::kServer) files.push_back({folder / kRegisterFile, text});
  }
  if (Status written = write_all(files); !written) return written;
  identities_ = std::move(changed);
  return {};
}

}  // namespace cairn
