// SPDX-License-Identifier: Apache-2.0
#include "common/io/distinct_files.h"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <fstream>

#include "common/io/test_directory.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;

class DistinctFiles : public ::testing::Test {
 protected:
  DistinctFiles() {
    std::ofstream(folder_ / "there") << "x";
    std::ofstream(folder_ / "other") << "x";
    std::filesystem::create_directory(folder_ / "sub");
    std::filesystem::create_symlink("there", folder_ / "link");
    std::filesystem::create_hard_link(folder_ / "there", folder_ / "hard");
    std::filesystem::create_symlink("../new", folder_ / "sub/dangling");
    mkfifo((folder_ / "pipe").c_str(), 0600);
  }
  [[nodiscard]] bool are_distinct(const std::string& a, const std::string& b) const {
    const Status outputs = check_distinct({{"--a", folder_ / a}, {"--b", folder_ / b}}, {});
    const Status input = check_distinct({{"--a", folder_ / a}}, {{"--b", folder_ / b}});
    EXPECT_EQ(outputs.has_value(), input.has_value()) << a << " " << b;
    return outputs.has_value();
  }

  TestDirectory directory_;
  const std::filesystem::path folder_ = directory_.path();
};

TEST_F(DistinctFiles, OneFileIsFoundUnderEachOfItsNames) {
  for (const char* name : {"there", "./there", "sub/../there", "link", "hard"})
    EXPECT_FALSE(are_distinct("there", name)) << name;
  EXPECT_FALSE(are_distinct("pipe", "./pipe"));
}

TEST_F(DistinctFiles, OneFileThatIsNotThereYetIsFoundUnderEachOfItsNames) {
  for (const char* name : {"new", "./new", "sub/../new", "sub/dangling"})
    EXPECT_FALSE(are_distinct("new", name)) << name;
  EXPECT_FALSE(std::filesystem::exists(folder_ / "new"));
}

TEST_F(DistinctFiles, TwoFilesAreTwo) {
  EXPECT_TRUE(are_distinct("there", "other"));
  EXPECT_TRUE(are_distinct("new", "there"));
  EXPECT_TRUE(are_distinct("new", "newer"));
  EXPECT_TRUE(are_distinct("new", "sub/new"));
  EXPECT_TRUE(are_distinct("no/folder/a", "no/folder/a"));  // whoever opens it says so
}

TEST_F(DistinctFiles, ADeviceMayBeNamedTwice) {
  EXPECT_TRUE(check_distinct({{"--a", "/dev/null"}, {"--b", "/dev/null"}}, {{"--c", "/dev/null"}}));
}

TEST_F(DistinctFiles, TheErrorNamesBothAndIsOfUsage) {
  const auto twice = check_distinct({{"--stats", folder_ / "there"}, {"--video", folder_ / "hard"}}, {});
  ASSERT_FALSE(twice);
  EXPECT_EQ(twice.error().code, ErrorCode::kUsage);
  EXPECT_THAT(twice.error().message, HasSubstr("--stats"));
  EXPECT_THAT(twice.error().message, HasSubstr("--video"));
}

}  // namespace
}  // namespace cairn
