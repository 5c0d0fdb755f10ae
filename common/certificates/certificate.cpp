// SPDX-License-Identifier: Apache-2.0
#include "common/certificates/certificate.h"

#include <openssl/err.h>
#include <openssl/pkcs7.h>

#include <algorithm>
#include <array>
#include <ctime>
#include <limits>
#include <span>

#include "common/io/text.h"

namespace cairn {
namespace {

constexpr size_t kMostBytes = 1 << 20;

/// The whole file as a BIO; `content` must outlive it.
Result<BioPtr> open_text(const std::filesystem::path& path, std::string* content) {
  auto read = read_file(path, kMostBytes);
  if (!read) return fail(ErrorCode::kConfiguration, read.error().message);
  *content = *std::move(read);
  return BioPtr(BIO_new_mem_buf(content->data(), static_cast<int>(content->size())));
}

/// A key with a password is refused instead of asked for on the terminal: programs start unattended.
int no_password(char* /*buffer*/, int /*size*/, int /*writes*/, void* /*data*/) {
  return -1;
}

std::string entry_of(const X509& certificate, int kind) {
  const X509_NAME* subject = X509_get_subject_name(&certificate);
  const int at = X509_NAME_get_index_by_NID(subject, kind, -1);
  if (at < 0) return {};
  const ASN1_STRING* text = X509_NAME_ENTRY_get_data(X509_NAME_get_entry(subject, at));
  return {reinterpret_cast<const char*>(ASN1_STRING_get0_data(text)),
          static_cast<size_t>(ASN1_STRING_length(text))};
}

/// Converts an ASN.1 time. A time that a Timestamp cannot hold, as the year 9999 of a certificate that never
/// expires, becomes the nearest one that it can; a time that cannot be read becomes the Unix epoch.
Timestamp time_of(const ASN1_TIME* time) {
  constexpr int64_t kNanoseconds = 1'000'000'000;
  constexpr int64_t kMostSeconds = std::numeric_limits<int64_t>::max() / kNanoseconds;
  std::tm parts{};
  if (ASN1_TIME_to_tm(time, &parts) != 1) return {};
  return {std::clamp<int64_t>(timegm(&parts), -kMostSeconds, kMostSeconds) * kNanoseconds};
}

std::string hex_of(const ASN1_INTEGER* number) {
  const std::unique_ptr<BIGNUM, FreedBy<&BN_free>> big(ASN1_INTEGER_to_BN(number, nullptr));
  char* text = big ? BN_bn2hex(big.get()) : nullptr;
  std::string hex = text != nullptr ? text : "";
  OPENSSL_free(text);
  return hex;
}

/// PKCS7_verify() takes memory that it does not give back of several digests, or, where it cannot begin with
/// a digest, of a text that lies in memory: those it is not shown.
bool has_one_digest(const PKCS7& signature) {
  return OBJ_obj2nid(signature.type) == NID_pkcs7_signed && signature.d.sign != nullptr &&
         sk_X509_ALGOR_num(signature.d.sign->md_algs) == 1;
}

}  // namespace

std::string crypto_error() {
  const unsigned long code = ERR_peek_last_error();
  ERR_clear_error();
  std::array<char, 256> text{};
  ERR_error_string_n(code, text.data(), text.size());
  return code == 0 ? "no reason given" : text.data();
}

Result<CertificatePtr> read_certificate(const std::filesystem::path& path) {
  std::string content;
  const auto text = open_text(path, &content);
  if (!text) return tl::unexpected(text.error());
  CertificatePtr certificate(PEM_read_bio_X509(text->get(), nullptr, no_password, nullptr));
  if (certificate) return certificate;
  return fail(ErrorCode::kConfiguration, path.string() + ": not a certificate (PEM): " + crypto_error());
}

Result<KeyPtr> read_private_key(const std::filesystem::path& path) {
  std::string content;
  const auto text = open_text(path, &content);
  if (!text) return tl::unexpected(text.error());
  KeyPtr key(PEM_read_bio_PrivateKey(text->get(), nullptr, no_password, nullptr));
  OPENSSL_cleanse(content.data(), content.size());
  if (key) return key;
  return fail(ErrorCode::kConfiguration,
              path.string() + ": not a private key without a password (PEM): " + crypto_error());
}

CertificateFacts facts_of(const X509& certificate) {
  return {entry_of(certificate, NID_organizationalUnitName), entry_of(certificate, NID_commonName),
          hex_of(X509_get0_serialNumber(&certificate)), time_of(X509_get0_notBefore(&certificate)),
          time_of(X509_get0_notAfter(&certificate))};
}

std::string subject_of(const X509& certificate) {
  const BioPtr text(BIO_new(BIO_s_mem()));
  X509_NAME_print_ex(text.get(), X509_get_subject_name(&certificate), 0, XN_FLAG_RFC2253);
  char* begin = nullptr;
  const long length = BIO_get_mem_data(text.get(), &begin);
  return {begin, static_cast<size_t>(length)};
}

Result<std::string> verify_document(const std::string& signed_text, X509& authority) {
  const BioPtr in(BIO_new_mem_buf(signed_text.data(), static_cast<int>(signed_text.size())));
  BIO* content = nullptr;
  const std::unique_ptr<PKCS7, FreedBy<&PKCS7_free>> signature(SMIME_read_PKCS7(in.get(), &content));
  BioPtr text(content);
  if (!signature || !text || !has_one_digest(*signature))
    return fail(ErrorCode::kConfiguration, "not a signed document: " + crypto_error());
  const std::unique_ptr<X509_STORE, FreedBy<&X509_STORE_free>> trusted(X509_STORE_new());
  const BioPtr out(BIO_new(BIO_s_mem()));
  const BioPtr not_in_memory(BIO_new(BIO_f_null()));
  if (not_in_memory) BIO_push(not_in_memory.get(), text.release());
  // Signers are looked for among the authorities alone: who brings a certificate of its own is not heard.
  const std::unique_ptr<STACK_OF(X509), FreedBy<[](STACK_OF(X509) * stack) { sk_X509_free(stack); }>> signers(
      sk_X509_new_null());
  const bool is_verified = trusted && out && not_in_memory && signers &&
                           sk_X509_push(signers.get(), &authority) > 0 &&
                           X509_STORE_add_cert(trusted.get(), &authority) == 1 &&
                           PKCS7_verify(signature.get(), signers.get(), trusted.get(), not_in_memory.get(),
                                        out.get(), PKCS7_TEXT | PKCS7_NOINTERN) == 1;
  if (!is_verified)
    return fail(ErrorCode::kConfiguration, "not signed by its authority, or changed: " + crypto_error());
  char* begin = nullptr;
  const long length = BIO_get_mem_data(out.get(), &begin);
  return std::string(begin, static_cast<size_t>(length));
}

Result<RevocationsPtr> read_revocations(const std::filesystem::path& path) {
  std::string content;
  const auto text = open_text(path, &content);
  if (!text) return tl::unexpected(text.error());
  RevocationsPtr revocations(PEM_read_bio_X509_CRL(text->get(), nullptr, no_password, nullptr));
  if (revocations) return revocations;
  return fail(ErrorCode::kConfiguration,
              path.string() + ": not a list of revoked certificates (PEM): " + crypto_error());
}

RevocationFacts facts_of(X509_CRL& revocations) {
  const ASN1_TIME* expires = X509_CRL_get0_nextUpdate(&revocations);
  return {time_of(X509_CRL_get0_lastUpdate(&revocations)),
          expires == nullptr ? Timestamp{} : time_of(expires),
          static_cast<size_t>(std::max(0, sk_X509_REVOKED_num(X509_CRL_get_REVOKED(&revocations))))};
}

std::string fingerprint_of(const X509& certificate) {
  std::array<uint8_t, EVP_MAX_MD_SIZE> digest{};
  unsigned int bytes = 0;
  if (X509_digest(&certificate, EVP_sha256(), digest.data(), &bytes) != 1) bytes = 0;
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string hex;
  for (const uint8_t byte : std::span(digest).first(bytes))
    hex.append({kDigits[byte >> 4], kDigits[byte & 15]});
  return hex;
}

bool is_signed_by(X509_CRL& revocations, const X509& authority) {
  const bool is_signed = X509_CRL_verify(&revocations, X509_get0_pubkey(&authority)) == 1;
  ERR_clear_error();
  return is_signed;
}

bool is_revoked(X509_CRL& revocations, const X509& certificate) {
  X509_REVOKED* row = nullptr;
  return X509_CRL_get0_by_cert(&revocations, &row, const_cast<X509*>(&certificate)) == 1;
}

bool is_signed_by(const X509& certificate, const X509& authority) {
  // libcrypto takes what it does not change as not const, here and in the next function.
  const bool is_signed = X509_verify(const_cast<X509*>(&certificate), X509_get0_pubkey(&authority)) == 1;
  ERR_clear_error();
  return is_signed;
}

bool belongs_to(const EVP_PKEY& key, const X509& certificate) {
  const bool belongs = X509_check_private_key(&certificate, const_cast<EVP_PKEY*>(&key)) == 1;
  ERR_clear_error();
  return belongs;
}

}  // namespace cairn
