// SPDX-License-Identifier: Apache-2.0
#include "server/keys/keystore.h"
#include "server/keys/site_keys.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openssl/x509v3.h>
#include <sys/stat.h>

#include <chrono>
#include <string>

#include "common/io/test_directory.h"
#include "common/io/text.h"
#include "server/keys/whole_file.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;
using std::chrono::hours;
using ::testing::HasSubstr;

/// Of this moment, to the second: libcrypto judges signatures by the machine's clock.
const Timestamp kNow{
    std::chrono::duration_cast<std::chrono::seconds>(std::chrono::system_clock::now().time_since_epoch())
        .count() *
    1'000'000'000};
constexpr hours kMonth{24 * 30};

mode_t mode_of(const fs::path& path) {
  struct stat status {};
  EXPECT_EQ(stat(path.c_str(), &status), 0) << path;
  return status.st_mode & 0777;
}

Identity identity(IdentityRole role, const std::string& name) {
  Identity made;
  made.role = role;
  made.name = name;
  return made;
}

class KeystoreTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const Status made = Keystore::init(keys_, kNow);
    ASSERT_TRUE(made) << made.error().message;
  }
  Keystore open() const { return Keystore::open(keys_).value(); }
  fs::path issue(IdentityRole role, const std::string& name) {
    const auto made = open().issue(identity(role, name), kMonth, kNow);
    EXPECT_TRUE(made) << made.error().message;
    return made.value_or(fs::path());
  }
  /// Nothing hidden or with a temporary name is left.
  void expect_nothing_unfinished() const {
    for (const auto& entry : fs::recursive_directory_iterator(directory_.path())) {
      const std::string name = entry.path().filename().string();
      EXPECT_FALSE(name.starts_with('.')) << entry.path();
      EXPECT_EQ(name.find(".json."), std::string::npos) << entry.path();
    }
  }

  const TestDirectory directory_;
  const fs::path keys_ = directory_.path() / "keys";
};

TEST_F(KeystoreTest, SecretsAreForTheirOwnerOnly) {
  const fs::path phone = issue(IdentityRole::kClient, "phone-1");
  EXPECT_EQ(mode_of(keys_), 0700U);
  EXPECT_EQ(mode_of(keys_ / "private/identity_ca.key.pem"), 0600U);
  EXPECT_EQ(mode_of(keys_ / "private/permissions_ca.key.pem"), 0600U);
  EXPECT_EQ(mode_of(phone), 0700U);
  EXPECT_EQ(mode_of(phone / "key.pem"), 0600U);
  EXPECT_EQ(mode_of(phone / "tag"), 0600U);
  expect_nothing_unfinished();
}

TEST_F(KeystoreTest, AnIdentityCanSignNoDocumentAndTheAuthoritiesAreTwo) {
  const fs::path phone = issue(IdentityRole::kClient, "phone-1");
  const auto own = read_certificate(phone / "cert.pem").value();
  const auto identities = read_certificate(phone / "identity_ca.cert.pem").value();
  const auto documents = read_certificate(phone / "permissions_ca.cert.pem").value();
  EXPECT_TRUE(is_signed_by(*own, *identities));
  EXPECT_FALSE(is_signed_by(*own, *documents));
  EXPECT_FALSE(is_signed_by(*documents, *identities));
  EXPECT_EQ(X509_get_extended_key_usage(own.get()), uint32_t{XKU_SSL_CLIENT | XKU_SSL_SERVER});
  EXPECT_EQ(X509_get_extended_key_usage(identities.get()), uint32_t{XKU_SSL_CLIENT | XKU_SSL_SERVER});
  EXPECT_EQ(X509_get_extended_key_usage(documents.get()), uint32_t{XKU_SMIME});
  EXPECT_EQ(X509_get_key_usage(documents.get()) & KU_KEY_CERT_SIGN, 0U);
  EXPECT_TRUE(belongs_to(*read_private_key(phone / "key.pem").value(), *own));
  EXPECT_EQ(subject_of(*own), "CN=phone-1,OU=client,O=cairn");
  EXPECT_EQ(facts_of(*own).expires, kNow + kMonth);
}

TEST_F(KeystoreTest, PermissionsAreGoodWithTheSignatureOfTheirAuthorityAlone) {
  const fs::path phone = issue(IdentityRole::kClient, "phone-1");
  const auto identities = read_certificate(phone / "identity_ca.cert.pem").value();
  const auto documents = read_certificate(phone / "permissions_ca.cert.pem").value();
  const std::string text = read_file(phone / "permissions.p7s").value();
  const auto verified = verify_document(text, *documents);
  ASSERT_TRUE(verified) << verified.error().message;
  EXPECT_THAT(*verified, HasSubstr("<subject_name>CN=phone-1,OU=client,O=cairn</subject_name>"));
  EXPECT_FALSE(verify_document(text, *identities));
  std::string changed = text;
  changed.replace(changed.find("client.phone-1"), 14, "client.phone-2");
  EXPECT_FALSE(verify_document(changed, *documents));
  EXPECT_FALSE(verify_document(text.substr(0, text.size() / 2), *documents));

  // Whoever has an identity signs with it: the signature is good, and nobody's who may.
  const KeyPair own{read_private_key(phone / "key.pem").value(),
                    read_certificate(phone / "cert.pem").value()};
  EXPECT_FALSE(verify_document(sign_document(own, "x").value(), *documents));
  EXPECT_FALSE(verify_document(sign_document(own, "x").value(), *identities));
}

TEST_F(KeystoreTest, ANameIsIssuedOnceAndRenewedWithANewSerial) {
  const fs::path phone = issue(IdentityRole::kClient, "phone-1");
  const auto again = open().issue(identity(IdentityRole::kClient, "phone-1"), kMonth, kNow);
  ASSERT_FALSE(again);
  EXPECT_EQ(again.error().code, ErrorCode::kRefused);
  EXPECT_THAT(again.error().message, HasSubstr("keys renew client phone-1"));
  issue(IdentityRole::kRig, "phone-1");  // of another role it is another

  const std::string before = facts_of(*read_certificate(phone / "cert.pem").value()).serial;
  const Timestamp later = kNow + hours(24);
  const auto renewed = open().renew(IdentityRole::kClient, "phone-1", kMonth, later);
  ASSERT_TRUE(renewed) << renewed.error().message;
  EXPECT_EQ(*renewed, phone);
  const CertificateFacts facts = facts_of(*read_certificate(phone / "cert.pem").value());
  EXPECT_NE(facts.serial, before);
  EXPECT_EQ(facts.expires, later + kMonth);
  const Identity known = open().identities().at({IdentityRole::kClient, "phone-1"});
  ASSERT_EQ(known.issues.size(), 2U);
  EXPECT_EQ(known.issues[0].serial, before);
  EXPECT_EQ(known.issues[1].serial, facts.serial);
  expect_nothing_unfinished();
}

TEST_F(KeystoreTest, WhoIsRevokedStaysSoUntilItsKeysHaveExpired) {
  const fs::path server = issue(IdentityRole::kServer, "server");
  const fs::path phone = issue(IdentityRole::kClient, "phone-1");
  const fs::path rig = issue(IdentityRole::kRig, "shoulder");
  const std::string before = read_file(server / "crl.pem").value();
  EXPECT_EQ(read_file(rig / "crl.pem").value(), before);
  EXPECT_FALSE(SiteKeys::read(server)->is_revoked(IdentityRole::kClient, "phone-1"));
  const Status revoked = open().revoke(IdentityRole::kClient, "phone-1", kNow);
  ASSERT_TRUE(revoked) << revoked.error().message;
  EXPECT_TRUE(SiteKeys::read(server)->is_revoked(IdentityRole::kClient, "phone-1"));
  EXPECT_NE(read_file(server / "crl.pem").value(), before);
  EXPECT_EQ(read_file(rig / "crl.pem").value(), read_file(server / "crl.pem").value()) << "of every role";
  EXPECT_FALSE(fs::exists(phone));

  const auto renewed = open().renew(IdentityRole::kClient, "phone-1", kMonth, kNow);
  ASSERT_FALSE(renewed);
  EXPECT_EQ(renewed.error().code, ErrorCode::kRefused);
  const auto early = open().issue(identity(IdentityRole::kClient, "phone-1"), kMonth, kNow + hours(1));
  ASSERT_FALSE(early);
  EXPECT_THAT(early.error().message, HasSubstr("take another"));
  const auto late = open().issue(identity(IdentityRole::kClient, "phone-1"), kMonth, kNow + kMonth);
  EXPECT_TRUE(late) << late.error().message;
  EXPECT_FALSE(SiteKeys::read(server)->is_revoked(IdentityRole::kClient, "phone-1"));
  EXPECT_EQ(open().revoke(IdentityRole::kRig, "nobody", kNow).error().code, ErrorCode::kNotFound);
}

TEST_F(KeystoreTest, WhatIsMissingOrWrongIsNamedAndNothingIsChanged) {
  const auto error_of = [this](const Identity& wanted, Timestamp now = kNow) {
    const auto made = open().issue(wanted, kMonth, now);
    return made ? Error{ErrorCode::kInternal, "made"} : made.error();
  };
  EXPECT_EQ(error_of(identity(IdentityRole::kClient, "../server")).code, ErrorCode::kUsage);
  EXPECT_EQ(error_of(identity(IdentityRole::kClient, "")).code, ErrorCode::kUsage);
  Identity rig = identity(IdentityRole::kRig, "arm");
  rig.groups = {"crew"};
  EXPECT_EQ(error_of(rig).code, ErrorCode::kUsage);
  const Identity phone = identity(IdentityRole::kClient, "phone-1");
  EXPECT_THAT(error_of(phone, kNow + hours(24 * 4000)).message, HasSubstr("has expired"));
  fs::rename(keys_ / "private/permissions_ca.key.pem", keys_ / "away");
  EXPECT_THAT(error_of(phone).message, HasSubstr("private/permissions_ca.key.pem"));
  fs::copy(keys_ / "private/identity_ca.key.pem", keys_ / "private/permissions_ca.key.pem");
  EXPECT_THAT(error_of(phone).message, HasSubstr("not the key of"));
  EXPECT_TRUE(open().identities().empty());
  EXPECT_FALSE(fs::exists(keys_ / "enclaves/client"));
  EXPECT_EQ(Keystore::init(keys_, kNow).error().code, ErrorCode::kRefused);
  const auto none = Keystore::open("none");
  ASSERT_FALSE(none);
  const std::string& said = none.error().message;
  EXPECT_THAT(said, HasSubstr((fs::current_path() / "none").string())) << "where it was looked for";
  EXPECT_LT(said.find("--keys DIR"), said.find("keys init")) << "another folder before another site";
}

TEST_F(KeystoreTest, AnAuthorityLimitsHowLongAnIdentityIsGood) {
  const auto made = open().issue(identity(IdentityRole::kClient, "phone-1"), hours(24 * 9999), kNow);
  ASSERT_TRUE(made);
  EXPECT_EQ(facts_of(*read_certificate(*made / "cert.pem").value()).expires,
            facts_of(*read_certificate(*made / "identity_ca.cert.pem").value()).expires);
}

TEST(WholeFile, WhatCannotBeWrittenLeavesNothing) {
  const TestDirectory directory;
  const fs::path folder = directory.path() / "a";
  {
    auto unfinished = UnfinishedFolder::make_beside(folder).value();
    ASSERT_TRUE(write_whole_file(unfinished.path() / "f", "1", kSecretFile));
  }
  EXPECT_TRUE(fs::is_empty(directory.path()));
  const Status missing = write_whole_file(directory.path() / "none/f", "1", kPublicFile);
  ASSERT_FALSE(missing);
  EXPECT_THAT(missing.error().message, HasSubstr("none/f"));
}

}  // namespace
}  // namespace cairn
