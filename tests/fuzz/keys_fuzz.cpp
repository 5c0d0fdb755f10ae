// SPDX-License-Identifier: Apache-2.0
//
// Keys of a secured site, as they are copied from machine to machine: the register, certificates, private
// keys, and documents behind the certificate of who has signed them. The first byte says which.
#include <string>

#include "common/base/utc.h"
#include "common/certificates/certificate.h"
#include "server/keys/authority.h"
#include "server/keys/identity.h"
#include "server/keys/permissions.h"
#include "tests/fuzz/fuzz_target.h"

namespace cairn::fuzz {
namespace {

enum Kind : uint8_t { kRegister, kCertificate, kKey, kDocument, kKinds };

void read_a_register(Bytes bytes) {
  const auto identities = parse_register(text_of(bytes));
  if (!identities) return demand(!identities.error().message.empty(), "a refusal has a reason");
  const auto again = parse_register(to_text(*identities));
  demand(again && *again == *identities, "a register that is read is written and read back");
}

void read_a_certificate(Bytes bytes) {
  const MemoryFile file(bytes);
  const auto certificate = read_certificate(file.path());
  if (!certificate) return;
  const CertificateFacts facts = facts_of(**certificate);
  demand(facts.serial.find_first_not_of("-0123456789ABCDEF") == std::string::npos, "a serial number is hex");
  static_cast<void>(to_utc(facts.begins) + to_utc(facts.expires));
  static_cast<void>(subject_of(**certificate));
  static_cast<void>(is_signed_by(**certificate, **certificate));
  demand(to_pem(**certificate).has_value(), "a certificate that is read can be written");
}

void read_a_key(Bytes bytes) {
  const MemoryFile file(bytes);
  if (const auto key = read_private_key(file.path())) static_cast<void>(to_pem(**key));
}

/// Behind the certificate of the authority, and a byte 0.
void read_a_document(Bytes bytes) {
  const std::string_view text = text_of(bytes);
  const size_t end = std::min(text.find('\0'), text.size());
  const MemoryFile file(bytes_of(text.substr(0, end)));
  const auto authority = read_certificate(file.path());
  if (!authority || end == text.size()) return;
  const auto document = verify_document(std::string(text.substr(end + 1)), **authority);
  if (!document) demand(!document.error().message.empty(), "a refusal has a reason");
}

Input signed_document(const KeyPair& authority, const std::string& text) {
  const auto document = sign_document(authority, text);
  const auto certificate = to_pem(*authority.certificate);
  demand(document && certificate, "a document can be signed");
  return input_of(kDocument, *certificate + '\0' + *document);
}

}  // namespace

void decode(Bytes bytes) {
  if (bytes.empty()) return;
  const Bytes rest = bytes.subspan(1);
  switch (bytes[0] % kKinds) {
    case kRegister:
      return read_a_register(rest);
    case kCertificate:
      return read_a_certificate(rest);
    case kKey:
      return read_a_key(rest);
    default:
      return read_a_document(rest);
  }
}

std::vector<Input> seeds() {
  constexpr Timestamp kFrom{1'700'000'000'000'000'000};
  constexpr Timestamp kUntil{1'900'000'000'000'000'000};
  const Validity validity{kFrom, kUntil};
  Identity ann{IdentityRole::kOperator, "ann", {}, "", "", Duty::kWatch, {{"0AF3", kUntil}}, {}};
  Identity phone{IdentityRole::kClient, "phone-1", {"crew"}, "shoulder", "bob", Duty::kWatch, {}, kFrom};
  const Register identities{{{ann.role, ann.name}, ann}, {{phone.role, phone.name}, phone}};
  const auto authority = make_authority("a site", Signs::kIdentities, validity);
  const auto documents = make_authority("a site", Signs::kDocuments, validity);
  demand(authority && documents, "there are authorities");
  const auto own = make_identity(*authority, "client", "phone-1", validity);
  demand(own.has_value(), "there is an identity");
  const auto certificate = to_pem(*own->certificate);
  const auto key = to_pem(*own->key);
  demand(certificate && key, "both can be written");
  return {input_of(kRegister, to_text(identities)),
          input_of(kRegister, to_text(Register{})),
          input_of(kCertificate, *certificate),
          input_of(kKey, *key),
          signed_document(*documents, make_governance()),
          signed_document(*documents, make_permissions(phone, subject_of(*own->certificate), validity))};
}

}  // namespace cairn::fuzz
