// SPDX-License-Identifier: Apache-2.0
#include "server/admin/doctor_security.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "common/io/test_directory.h"
#include "server/keys/keystore.h"

namespace cairn {
namespace {

using std::chrono::hours;
using ::testing::HasSubstr;
using Grade = Finding::Grade;

const Timestamp kNow = wall_clock_now();  // signatures are judged by the clock of this machine

TEST(DoctorSecurity, ACertificateIsToldBeforeItExpires) {
  EXPECT_EQ(judge_certificate("client phone-1", kNow + hours(24 * 30), kNow).grade, Grade::kOk);
  EXPECT_EQ(judge_certificate("client phone-1", kNow + hours(24 * 3), kNow).grade, Grade::kWarning);
  const Finding late = judge_certificate("client phone-1", kNow + hours(-24), kNow);
  EXPECT_EQ(late.grade, Grade::kProblem);
  EXPECT_THAT(late.remedy, HasSubstr("keys renew client phone-1"));
}

/// A site that is made now, with an operator whose keys last 30 days.
class DoctorOfASite : public ::testing::Test {
 protected:
  DoctorOfASite() {
    if (!Keystore::init(keys_, kNow)) throw std::runtime_error("no keys");
    auto keys = Keystore::open(keys_);
    Identity ann;
    ann.role = IdentityRole::kOperator;
    ann.name = "ann";
    folder_ = keys->issue(ann, hours(24 * 30), kNow).value();
    Identity phone;
    phone.name = "phone-1";
    phone_ = keys->issue(phone, hours(24), kNow).value();
  }
  static std::vector<Grade> grades(const std::vector<Finding>& findings) {
    std::vector<Grade> all;
    for (const Finding& finding : findings) all.push_back(finding.grade);
    return all;
  }
  const TestDirectory directory_;
  const std::filesystem::path keys_ = directory_.path() / "keys";
  std::filesystem::path folder_;
  std::filesystem::path phone_;
};

/// Before, the server was said to be in the way, and its operator told to start it.
TEST_F(DoctorOfASite, AServerIsAskedWithTheKeysOfAnOperatorAlone) {
  EXPECT_FALSE(why_not_asked(folder_, kNow));
  const auto of_client = why_not_asked(phone_, kNow);
  ASSERT_TRUE(of_client);
  EXPECT_EQ(of_client->grade, Grade::kWarning) << "nothing is wrong with the device";
  EXPECT_THAT(of_client->detail, HasSubstr("of client phone-1"));
  EXPECT_THAT(of_client->remedy, HasSubstr("an operator's keys"));
  EXPECT_TRUE(why_not_asked(folder_, kNow + hours(24 * 31))) << "they have expired";
}

TEST_F(DoctorOfASite, OwnKeysTheirAuthoritiesAndTheListOfTheRevokedAreLookedAt) {
  const auto well = look_at_security(folder_, kNow);
  ASSERT_THAT(grades(well), testing::ElementsAre(Grade::kOk, Grade::kOk, Grade::kOk));
  EXPECT_THAT(well[2].detail, HasSubstr("names 0 certificates"));
  EXPECT_EQ(look_at_security(folder_, kNow + hours(24 * 20))[0].grade, Grade::kWarning);
  ASSERT_TRUE(Keystore::open(keys_)->revoke(IdentityRole::kClient, "phone-1", kNow));
  EXPECT_THAT(look_at_security(folder_, kNow)[2].detail, HasSubstr("names 1 certificate"));
}

TEST_F(DoctorOfASite, AuthoritiesAndAListThatExpireSoonAreToldInTime) {
  const Timestamp late = kNow + hours(24 * 3645);
  auto keys = Keystore::open(keys_);
  (void)keys->renew(IdentityRole::kOperator, "ann", hours(24 * 365), kNow + hours(24 * 3640)).value();
  EXPECT_THAT(grades(look_at_security(folder_, late)),
              testing::ElementsAre(Grade::kWarning, Grade::kWarning, Grade::kWarning));
}

TEST_F(DoctorOfASite, AFolderThatIsNotWholeOrHasExpiredIsAProblem) {
  const auto expired = look_at_security(folder_, kNow + hours(24 * 31));
  ASSERT_EQ(grades(expired), std::vector{Grade::kProblem});
  EXPECT_THAT(expired[0].detail, HasSubstr("has expired"));
  std::filesystem::remove(folder_ / "crl.pem");
  const auto partly = look_at_security(folder_, kNow);
  ASSERT_EQ(grades(partly), std::vector{Grade::kProblem});
  EXPECT_THAT(partly[0].detail, HasSubstr("crl.pem"));
  EXPECT_FALSE(partly[0].remedy.empty());
}

TEST_F(DoctorOfASite, OfAllKeysOfASiteTheOneThatExpiresFirstIsTold) {
  EXPECT_THAT(look_at_certificates(keys_, kNow).detail, HasSubstr("client phone-1"));
  ASSERT_TRUE(Keystore::open(keys_)->revoke(IdentityRole::kClient, "phone-1", kNow));
  const Finding next = look_at_certificates(keys_, kNow);
  EXPECT_THAT(next.detail, HasSubstr("operator ann"));
  EXPECT_EQ(next.grade, Grade::kOk);
  EXPECT_EQ(look_at_certificates(directory_.path(), kNow).grade, Grade::kProblem);
}

}  // namespace
}  // namespace cairn
