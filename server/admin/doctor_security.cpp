// SPDX-License-Identifier: Apache-2.0
#include "server/admin/doctor_security.h"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <optional>
#include <utility>

#include "common/base/utc.h"
#include "common/certificates/certificate.h"
#include "common/wire/security.h"
#include "server/keys/identity.h"

namespace cairn {
namespace {

using Grade = Finding::Grade;
namespace fs = std::filesystem;

constexpr std::chrono::hours kSoon{24 * 14};

Grade grade_of(Timestamp expires, Timestamp now) {
  if (expires <= now) return Grade::kProblem;
  return expires <= now + kSoon ? Grade::kWarning : Grade::kOk;
}

/// "has expired, 2027-..." or "expires 2027-...".
std::string when(Timestamp expires, Timestamp now) {
  return (expires <= now ? "has expired, " : "expires ") + to_utc(expires);
}

Finding look_at_authorities(const fs::path& folder, Timestamp now) {
  std::optional<std::pair<std::string, Timestamp>> first;
  for (const char* file : {"identity_ca.cert.pem", "permissions_ca.cert.pem"}) {
    const auto certificate = read_certificate(folder / file);
    if (!certificate)
      return {"authorities", Grade::kProblem, certificate.error().message, "copy the folder anew"};
    const Timestamp expires = facts_of(**certificate).expires;
    if (!first || expires < first->second) first = {file, expires};
  }
  const Grade grade = grade_of(first->second, now);
  return {"authorities", grade, first->first + " " + when(first->second, now),
          grade == Grade::kOk
              ? ""
              : "`cairnctl keys init --keys NEW-FOLDER` makes new ones; all devices need new keys then"};
}

Finding look_at_revocations(const fs::path& folder, Timestamp now) {
  const auto revocations = read_revocations(folder / "crl.pem");
  if (!revocations)
    return {"revoked", Grade::kProblem, revocations.error().message, "copy it from the folder of the keys"};
  const RevocationFacts facts = facts_of(**revocations);
  const Grade grade = grade_of(facts.expires, now);
  return {"revoked", grade,
          "crl.pem of " + to_utc(facts.made) + " names " + std::to_string(facts.certificates) +
              (facts.certificates == 1 ? " certificate" : " certificates") +
              (grade == Grade::kOk ? "" : ", and " + when(facts.expires, now)),
          grade == Grade::kOk ? "" : "copy a newer one from the folder of the keys"};
}

}  // namespace

Finding judge_certificate(const std::string& name, Timestamp expires, Timestamp now) {
  const Grade grade = grade_of(expires, now);
  return {"certificates", grade, "that of " + name + " " + when(expires, now),
          grade == Grade::kOk ? "" : "`cairnctl keys renew " + name + "`, and copy its folder to the device"};
}

std::vector<Finding> look_at_security(const std::string& folder, Timestamp now) {
  const auto security = wire::read_security(folder, now);
  if (!security)
    return {{"certificates", Grade::kProblem, security.error().message,
             "`cairnctl keys issue` and `keys renew` make such folders; copy one of them here, whole"}};
  return {judge_certificate(security->role + " " + security->name, security->expires, now),
          look_at_authorities(security->folder, now), look_at_revocations(security->folder, now)};
}

std::optional<Finding> why_not_asked(const std::string& folder, Timestamp now) {
  const auto security = wire::read_security(folder, now);
  if (security && security->role == "operator") return std::nullopt;
  const std::string why = security ? "these keys are of " + security->role + " " + security->name
                                   : "these keys are of no use as they are";
  return Finding{"server", Grade::kWarning, "was not asked: it answers operators, and " + why,
                 "name the folder of an operator's keys with --security"};
}

Finding look_at_certificates(const std::string& folder, Timestamp now) {
  const auto known = read_register(fs::path(folder) / kRegisterFile);
  if (!known)
    return {"site keys", Grade::kProblem, known.error().message,
            "name the folder that `cairnctl keys init` has made with --keys"};
  std::optional<std::pair<std::string, Timestamp>> first;
  for (const auto& [key, identity] : *known) {
    if (identity.revoked || identity.issues.empty()) continue;
    const Timestamp expires = identity.issues.back().expires;
    if (!first || expires < first->second)
      first = {std::string(to_string(identity.role)) + " " + identity.name, expires};
  }
  if (!first) return {"site keys", Grade::kOk, "none was issued", ""};
  Finding finding = judge_certificate(first->first, first->second, now);
  finding.what = "site keys";
  finding.detail += ", before all others";
  return finding;
}

}  // namespace cairn
