// SPDX-License-Identifier: Apache-2.0
#include "server/admin/doctor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn {
namespace {

using ::testing::HasSubstr;
using Grade = Finding::Grade;

TEST(Doctor, PortsThatTheKernelGivesAwayAreNamedWithTheRemedy) {
  EXPECT_EQ(judge_ports("32768\t60999", "", 0).grade, Grade::kOk);
  const Finding among = judge_ports("32768\t60999", "", 120);
  EXPECT_EQ(among.grade, Grade::kWarning);
  EXPECT_THAT(among.remedy, HasSubstr("ip_local_reserved_ports=37410-37570"));
  EXPECT_EQ(judge_ports("32768\t60999", "80,37410-37570", 120).grade, Grade::kOk);
  EXPECT_EQ(judge_ports("32768\t60999", "37411-37570", 120).grade, Grade::kWarning);
  EXPECT_EQ(judge_ports("32768\t60999", "", 230).grade, Grade::kOk);
}

TEST(Doctor, SmallBuffersAndFullDisksAreNamedWithTheRemedy) {
  EXPECT_EQ(judge_buffers("4194304").grade, Grade::kOk);
  EXPECT_THAT(judge_buffers("212992").remedy, HasSubstr("sysctl net.core.rmem_max=4000000"));
  EXPECT_EQ(judge_buffers("").grade, Grade::kWarning);
  constexpr uint64_t kGigabyte = 1'000'000'000;
  EXPECT_EQ(judge_disk("/srv", 50 * kGigabyte, 100 * kGigabyte, true).grade, Grade::kOk);
  EXPECT_EQ(judge_disk("/srv", 4 * kGigabyte, 100 * kGigabyte, true).grade, Grade::kWarning);
  EXPECT_EQ(judge_disk("/srv", kGigabyte / 20, kGigabyte, true).grade, Grade::kProblem);
  EXPECT_THAT(judge_disk("/srv", 50 * kGigabyte, 100 * kGigabyte, false).detail,
              HasSubstr("cannot be written"));
}

}  // namespace
}  // namespace cairn
