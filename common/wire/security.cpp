// SPDX-License-Identifier: Apache-2.0
#include "common/wire/security.h"

#include <sys/stat.h>

#include <chrono>

#include "common/base/utc.h"
#include "common/certificates/certificate.h"
#include "common/io/text.h"
#include "common/map/ids.h"

namespace cairn::wire {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMostBytes = 1 << 20;

tl::unexpected<Error> wrong(const fs::path& file, const std::string& what) {
  return fail(ErrorCode::kConfiguration, file.string() + ": " + what);
}

/// Reads a file of a security folder. Where that fails, the error kConfiguration also says what --security
/// takes.
Result<std::string> text_in(const fs::path& file) {
  auto text = read_file(file, kMostBytes);
  if (text) return text;
  return fail(
      ErrorCode::kConfiguration,
      text.error().message + "; --security takes a folder that `cairnctl keys issue` has made, whole");
}

Status check_secret(const fs::path& file) {
  struct stat status {};
  if (stat(file.c_str(), &status) == 0 && (status.st_mode & 077) != 0)
    return wrong(file, "others can read it; `chmod 600` is what it needs");
  return {};
}

Status check_signed(const fs::path& file, X509& authority) {
  const auto text = text_in(file);
  if (!text) return tl::unexpected(text.error());
  const auto content = verify_document(*text, authority);
  return content ? Status() : wrong(file, content.error().message);
}

Status check_time(const fs::path& file, const CertificateFacts& facts, Timestamp now) {
  const std::string who = facts.role + " " + facts.name;
  if (facts.expires <= now)
    return wrong(file, "has expired at " + to_utc(facts.expires) + "; `cairnctl keys renew " + who +
                           "` makes new keys");
  if (facts.begins > now)
    return wrong(file, "is good from " + to_utc(facts.begins) + " on, and it is " + to_utc(now) +
                           " here: is the clock right?");
  return {};
}

/// Whom the middleware turns away. A list that is missing would let in whoever was revoked, unsaid.
Status check_revocations(const fs::path& file, const X509& authority, const X509& own) {
  const std::string remedy = "; copy crl.pem from the folder of the keys";
  const auto revocations = read_revocations(file);
  if (!revocations) return fail(ErrorCode::kConfiguration, revocations.error().message + remedy);
  if (!is_signed_by(**revocations, authority))
    return wrong(file, "not of the authority of identity_ca.cert.pem; of another site?" + remedy);
  const CertificateFacts facts = facts_of(own);
  if (!is_revoked(**revocations, own)) return {};
  return wrong(file, "the keys of " + facts.role + " " + facts.name +
                         " were revoked; `cairnctl keys issue` makes some of another name");
}

/// Reads the site's tag, 32 hex digits, from the first line of a file.
Result<std::string> read_tag(const fs::path& file) {
  const auto text = text_in(file);
  if (!text) return tl::unexpected(text.error());
  std::string tag = text->substr(0, text->find('\n'));
  const bool is_hex = tag.size() == 32 && tag.find_first_not_of("0123456789abcdef") == std::string::npos;
  if (!is_hex) return wrong(file, "expected the 32 hex digits of the site");
  return tag;
}

}  // namespace

Result<Security> read_security(const fs::path& folder, Timestamp now) {
  std::error_code problem;
  const fs::path place = fs::absolute(folder, problem).lexically_normal();
  for (const char* file : {"identity_ca.cert.pem", "permissions_ca.cert.pem", "cert.pem", "key.pem"})
    if (const auto text = text_in(place / file); !text) return tl::unexpected(text.error());
  if (Status secret = check_secret(place / "key.pem"); !secret) return tl::unexpected(secret.error());
  const auto identities = read_certificate(place / "identity_ca.cert.pem");
  if (!identities) return tl::unexpected(identities.error());
  const auto documents = read_certificate(place / "permissions_ca.cert.pem");
  if (!documents) return tl::unexpected(documents.error());
  const auto own = read_certificate(place / "cert.pem");
  if (!own) return tl::unexpected(own.error());
  const auto key = read_private_key(place / "key.pem");
  if (!key) return tl::unexpected(key.error());
  const CertificateFacts facts = facts_of(**own);
  if (is_signed_by(**documents, **identities))
    return wrong(place / "permissions_ca.cert.pem", "is, or is of, the authority of the identities too");
  if (!is_signed_by(**own, **identities))
    return wrong(place / "cert.pem", "not signed by the authority of identity_ca.cert.pem; of another site?");
  if (!belongs_to(**key, **own)) return wrong(place / "key.pem", "not the key of cert.pem");
  if (!is_valid_name(facts.name)) return wrong(place / "cert.pem", in_quotes(facts.name) + " is no name");
  if (Status time = check_time(place / "cert.pem", facts, now); !time) return tl::unexpected(time.error());
  for (const char* file : {"governance.p7s", "permissions.p7s"}) {
    if (Status good = check_signed(place / file, **documents); !good) return tl::unexpected(good.error());
  }
  const auto tag = read_tag(place / "tag");
  if (!tag) return tl::unexpected(tag.error());
  if (Status taken = check_revocations(place / "crl.pem", **identities, **own); !taken)
    return tl::unexpected(taken.error());
  return Security{place, facts.role, facts.name, *tag, fingerprint_of(**identities), facts.expires};
}

Result<Security> read_security(const fs::path& folder) {
  return read_security(folder, wall_clock_now());
}

Result<std::string> secured_name(const std::string& folder, std::string_view role,
                                 const std::string& wanted) {
  const auto security = read_security(folder);
  if (!security) return tl::unexpected(security.error());
  if (security->role != role) {
    return fail(ErrorCode::kConfiguration, folder + ": the keys are of " + security->role + " " +
                                               security->name + "; `cairnctl keys issue " +
                                               std::string(role) + "` makes those that are needed here");
  }
  if (wanted.empty() || wanted == security->name) return security->name;
  return fail(ErrorCode::kUsage, folder + ": the keys are of " + security->role + " " + security->name +
                                     ", not of " + wanted + "; without a name, that of the keys is taken");
}

}  // namespace cairn::wire
