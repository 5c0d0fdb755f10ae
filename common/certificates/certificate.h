// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "common/base/result.h"
#include "common/base/time.h"

/// X.509 certificates as DDS Security needs them, over libcrypto, which its plugins use too.
namespace cairn {

template <auto kFree>
struct FreedBy {
  template <typename T>
  void operator()(T* owned) const {
    kFree(owned);
  }
};
using KeyPtr = std::unique_ptr<EVP_PKEY, FreedBy<&EVP_PKEY_free>>;
using CertificatePtr = std::unique_ptr<X509, FreedBy<&X509_free>>;
using BioPtr = std::unique_ptr<BIO, FreedBy<&BIO_free_all>>;

/// Returns libcrypto's reason for the call that has just failed, in words, and empties its list of errors.
[[nodiscard]] std::string crypto_error();

/// Reads the certificate in a PEM file. Errors name the file: kConfiguration (missing, not readable, not a
/// certificate).
[[nodiscard]] Result<CertificatePtr> read_certificate(const std::filesystem::path& path);
[[nodiscard]] Result<KeyPtr> read_private_key(const std::filesystem::path& path);

/// What a certificate says about its holder, and when it is valid.
struct CertificateFacts {
  std::string role;    ///< organizational unit: client, server, operator or rig; of an authority: authority
  std::string name;    ///< common name
  std::string serial;  ///< hex digits, upper-case
  Timestamp begins;
  Timestamp expires;
};
[[nodiscard]] CertificateFacts facts_of(const X509& certificate);

/// The subject as permissions name it (RFC 2253): "CN=phone-1,OU=client,O=cairn".
[[nodiscard]] std::string subject_of(const X509& certificate);

/// The text of a document that this authority has signed, as S/MIME (DDS Security's governance and
/// permissions). Error kConfiguration: it is none, or signed by somebody else. Does not name the file.
[[nodiscard]] Result<std::string> verify_document(const std::string& signed_text, X509& authority);

using RevocationsPtr = std::unique_ptr<X509_CRL, FreedBy<&X509_CRL_free>>;
/// Reads the list of revoked certificates (CRL) in a PEM file; errors as those of read_certificate().
[[nodiscard]] Result<RevocationsPtr> read_revocations(const std::filesystem::path& path);
/// What a list of revoked certificates says of itself.
struct RevocationFacts {
  Timestamp made;
  Timestamp expires;
  size_t certificates = 0;  ///< how many it names
};
[[nodiscard]] RevocationFacts facts_of(X509_CRL& revocations);
/// Whether that authority has signed the list.
[[nodiscard]] bool is_signed_by(X509_CRL& revocations, const X509& authority);
[[nodiscard]] bool is_revoked(X509_CRL& revocations, const X509& certificate);

/// SHA-256 of the certificate, as 64 hex digits.
[[nodiscard]] std::string fingerprint_of(const X509& certificate);

/// Whether that authority has signed the certificate. Does not check when it is valid.
[[nodiscard]] bool is_signed_by(const X509& certificate, const X509& authority);
[[nodiscard]] bool belongs_to(const EVP_PKEY& key, const X509& certificate);

}  // namespace cairn
