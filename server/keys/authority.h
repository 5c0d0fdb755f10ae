// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "common/certificates/certificate.h"

/// The cryptographic part of the keys: authorities, certificates, signed documents, lists of what is revoked.
/// All texts are PEM or S/MIME. Errors are kInternal: libcrypto has no memory or no random numbers.
namespace cairn {

/// From when to when something is valid.
struct Validity {
  Timestamp begins;
  Timestamp expires;
};

/// A certificate and its private key.
struct KeyPair {
  KeyPtr key;
  CertificatePtr certificate;
};

/// What an authority signs: identities and nothing else, or documents and nothing else. One for both would
/// let every client sign permissions of its own (CVE-2023-24011).
enum class Signs { kIdentities, kDocuments };

/// Makes an authority, whose certificate is signed by itself.
[[nodiscard]] Result<KeyPair> make_authority(const std::string& name, Signs signs, const Validity& validity);

/// Makes the keys of a participant: their extended key usage is that of client and server alone, so that they
/// sign no document.
[[nodiscard]] Result<KeyPair> make_identity(const KeyPair& authority, const std::string& role,
                                            const std::string& name, const Validity& validity);

/// Signs a text, as S/MIME with the text in front, the form of the DDS Security specification.
[[nodiscard]] Result<std::string> sign_document(const KeyPair& authority, const std::string& text);

struct RevokedSerial {
  std::string serial;  ///< hex digits
  Timestamp since;
};
/// Makes a certificate revocation list.
[[nodiscard]] Result<std::string> make_revocations(const KeyPair& authority,
                                                   const std::vector<RevokedSerial>& revoked,
                                                   const Validity& validity);

[[nodiscard]] Result<std::string> to_pem(const X509& certificate);
[[nodiscard]] Result<std::string> to_pem(const EVP_PKEY& key);

}  // namespace cairn
