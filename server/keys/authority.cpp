// SPDX-License-Identifier: Apache-2.0
#include "server/keys/authority.h"

#include <openssl/err.h>
#include <openssl/pkcs7.h>
#include <openssl/x509v3.h>

#include <utility>

namespace cairn {
namespace {

constexpr const char* kCurve = "P-256";
constexpr int kSerialBits = 127;  ///< random: no two alike, never negative

using ExtensionPtr = std::unique_ptr<X509_EXTENSION, FreedBy<&X509_EXTENSION_free>>;
using NumberPtr = std::unique_ptr<BIGNUM, FreedBy<&BN_free>>;
using TimePtr = std::unique_ptr<ASN1_TIME, FreedBy<&ASN1_TIME_free>>;
using IntegerPtr = std::unique_ptr<ASN1_INTEGER, FreedBy<&ASN1_INTEGER_free>>;

tl::unexpected<Error> crypto_failure(const char* what) {
  return fail(ErrorCode::kInternal, std::string(what) + ": " + crypto_error());
}

time_t seconds_of(Timestamp time) {
  return static_cast<time_t>(time.nanoseconds / 1'000'000'000);
}

bool add_name(X509_NAME* name, const char* field, const std::string& value) {
  return X509_NAME_add_entry_by_txt(name, field, MBSTRING_ASC,
                                    reinterpret_cast<const unsigned char*>(value.data()),
                                    static_cast<int>(value.size()), -1, 0) == 1;
}

bool add_extension(X509* certificate, X509* issuer, int kind, const char* value) {
  X509V3_CTX context;
  X509V3_set_ctx_nodb(&context);
  X509V3_set_ctx(&context, issuer, certificate, nullptr, nullptr, 0);
  const ExtensionPtr extension(X509V3_EXT_conf_nid(nullptr, &context, kind, value));
  return extension && X509_add_ext(certificate, extension.get(), -1) == 1;
}

bool set_serial(X509* certificate) {
  const NumberPtr serial(BN_new());
  return serial && BN_rand(serial.get(), kSerialBits, BN_RAND_TOP_ANY, BN_RAND_BOTTOM_ANY) == 1 &&
         BN_to_ASN1_INTEGER(serial.get(), X509_get_serialNumber(certificate)) != nullptr;
}

/// A new key and a certificate of it, without extensions and signature.
Result<KeyPair> begin_certificate(const std::string& role, const std::string& name,
                                  const Validity& validity) {
  KeyPair made{KeyPtr(EVP_EC_gen(kCurve)), CertificatePtr(X509_new())};
  if (!made.key || !made.certificate) return crypto_failure("making a key");
  X509* const certificate = made.certificate.get();
  X509_NAME* const subject = X509_get_subject_name(certificate);
  const bool is_whole = X509_set_version(certificate, X509_VERSION_3) == 1 && set_serial(certificate) &&
                        ASN1_TIME_set(X509_getm_notBefore(certificate), seconds_of(validity.begins)) &&
                        ASN1_TIME_set(X509_getm_notAfter(certificate), seconds_of(validity.expires)) &&
                        X509_set_pubkey(certificate, made.key.get()) == 1 &&
                        add_name(subject, "O", "cairn") && add_name(subject, "OU", role) &&
                        add_name(subject, "CN", name);
  if (!is_whole) return crypto_failure("making a certificate");
  return made;
}

}  // namespace

Result<KeyPair> make_authority(const std::string& name, Signs signs, const Validity& validity) {
  auto made = begin_certificate("authority", name, validity);
  if (!made) return made;
  X509* const certificate = made->certificate.get();
  const bool signs_identities = signs == Signs::kIdentities;
  const bool is_whole =
      X509_set_issuer_name(certificate, X509_get_subject_name(certificate)) == 1 &&
      add_extension(certificate, certificate, NID_basic_constraints, "critical,CA:TRUE,pathlen:0") &&
      add_extension(certificate, certificate, NID_key_usage,
                    signs_identities ? "critical,keyCertSign,cRLSign" : "critical,digitalSignature") &&
      add_extension(certificate, certificate, NID_ext_key_usage,
                    signs_identities ? "clientAuth,serverAuth" : "emailProtection") &&
      add_extension(certificate, certificate, NID_subject_key_identifier, "hash") &&
      X509_sign(certificate, made->key.get(), EVP_sha256()) != 0;
  if (!is_whole) return crypto_failure("making an authority");
  return made;
}

Result<KeyPair> make_identity(const KeyPair& authority, const std::string& role, const std::string& name,
                              const Validity& validity) {
  auto made = begin_certificate(role, name, validity);
  if (!made) return made;
  X509* const certificate = made->certificate.get();
  X509* const issuer = authority.certificate.get();
  const bool is_whole =
      X509_set_issuer_name(certificate, X509_get_subject_name(issuer)) == 1 &&
      add_extension(certificate, issuer, NID_basic_constraints, "critical,CA:FALSE") &&
      add_extension(certificate, issuer, NID_key_usage, "critical,digitalSignature,keyAgreement") &&
      add_extension(certificate, issuer, NID_ext_key_usage, "critical,clientAuth,serverAuth") &&
      add_extension(certificate, issuer, NID_subject_key_identifier, "hash") &&
      add_extension(certificate, issuer, NID_authority_key_identifier, "keyid:always") &&
      X509_sign(certificate, authority.key.get(), EVP_sha256()) != 0;
  if (!is_whole) return crypto_failure("making an identity");
  return made;
}

namespace {

/// The text that `write` puts out.
template <typename Write>
Result<std::string> written(const char* what, const Write& write) {
  const BioPtr out(BIO_new(BIO_s_mem()));
  if (!out || !write(out.get())) return crypto_failure(what);
  char* begin = nullptr;
  const long length = BIO_get_mem_data(out.get(), &begin);
  return std::string(begin, static_cast<size_t>(length));
}

}  // namespace

Result<std::string> sign_document(const KeyPair& authority, const std::string& text) {
  constexpr int kForm = PKCS7_TEXT | PKCS7_DETACHED | PKCS7_STREAM;
  const BioPtr in(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
  const std::unique_ptr<PKCS7, FreedBy<&PKCS7_free>> signature(
      PKCS7_sign(authority.certificate.get(), authority.key.get(), nullptr, in.get(), kForm));
  if (!signature) return crypto_failure("signing a document");
  return written("signing a document",
                 [&](BIO* out) { return SMIME_write_PKCS7(out, signature.get(), in.get(), kForm) == 1; });
}

Result<std::string> make_revocations(const KeyPair& authority, const std::vector<RevokedSerial>& revoked,
                                     const Validity& validity) {
  const std::unique_ptr<X509_CRL, FreedBy<&X509_CRL_free>> list(X509_CRL_new());
  const TimePtr begins(ASN1_TIME_set(nullptr, seconds_of(validity.begins)));
  const TimePtr expires(ASN1_TIME_set(nullptr, seconds_of(validity.expires)));
  bool is_whole =
      list && begins && expires && X509_CRL_set_version(list.get(), X509_CRL_VERSION_2) == 1 &&
      X509_CRL_set_issuer_name(list.get(), X509_get_subject_name(authority.certificate.get())) == 1 &&
      X509_CRL_set1_lastUpdate(list.get(), begins.get()) == 1 &&
      X509_CRL_set1_nextUpdate(list.get(), expires.get()) == 1;
  for (size_t i = 0; is_whole && i < revoked.size(); ++i) {
    BIGNUM* number = nullptr;
    is_whole = BN_hex2bn(&number, revoked[i].serial.c_str()) != 0;
    const NumberPtr owned(number);
    const IntegerPtr serial(is_whole ? BN_to_ASN1_INTEGER(number, nullptr) : nullptr);
    const TimePtr since(ASN1_TIME_set(nullptr, seconds_of(revoked[i].since)));
    std::unique_ptr<X509_REVOKED, FreedBy<&X509_REVOKED_free>> row(X509_REVOKED_new());
    is_whole = serial && since && row && X509_REVOKED_set_serialNumber(row.get(), serial.get()) == 1 &&
               X509_REVOKED_set_revocationDate(row.get(), since.get()) == 1 &&
               X509_CRL_add0_revoked(list.get(), row.get()) == 1;
    if (is_whole) (void)row.release();  // the list has it
  }
  is_whole = is_whole && X509_CRL_sort(list.get()) == 1 &&
             X509_CRL_sign(list.get(), authority.key.get(), EVP_sha256()) != 0;
  if (!is_whole) return crypto_failure("making a revocation list");
  return written("making a revocation list",
                 [&](BIO* out) { return PEM_write_bio_X509_CRL(out, list.get()) == 1; });
}

Result<std::string> to_pem(const X509& certificate) {
  return written("writing a certificate",
                 [&](BIO* out) { return PEM_write_bio_X509(out, &certificate) == 1; });
}

Result<std::string> to_pem(const EVP_PKEY& key) {
  return written("writing a key", [&](BIO* out) {
    return PEM_write_bio_PrivateKey(out, &key, nullptr, nullptr, 0, nullptr, nullptr) == 1;
  });
}

}  // namespace cairn
