// SPDX-License-Identifier: Apache-2.0
#include "client/capture/source_uri.h"

#include <gmock/gmock.h>

namespace cairn {
namespace {

using ::testing::HasSubstr;
using ::testing::Pair;
using ::testing::UnorderedElementsAre;

TEST(SourceUri, SplitsSchemePathAndOptions) {
  const auto uri = parse_source_uri("video:/a:b/c?d.mp4?times=/a/times.txt&x=1");
  ASSERT_TRUE(uri) << uri.error().message;
  EXPECT_EQ(uri->scheme, "video");
  EXPECT_EQ(uri->path, "/a:b/c?d.mp4");
  EXPECT_THAT(uri->options, UnorderedElementsAre(Pair("times", "/a/times.txt"), Pair("x", "1")));
  EXPECT_TRUE(parse_source_uri("tum:dir")->options.empty());
  EXPECT_TRUE(parse_source_uri("tum:dir?")->options.empty());
}

TEST(SourceUri, OtherQuestionMarksBelongToThePathOrToAValue) {
  const auto uri = parse_source_uri("images:/what?/a?b?match=f-?.png&times=t?x.txt");
  ASSERT_TRUE(uri) << uri.error().message;
  EXPECT_EQ(uri->path, "/what?/a?b");
  EXPECT_THAT(uri->options, UnorderedElementsAre(Pair("match", "f-?.png"), Pair("times", "t?x.txt")));
}

TEST(SourceUri, RefusesWhatHasNoForm) {
  for (const auto* text : {"", "tum", ":dir", "tum:", "tum:?a=1", "/dev/video0", "tum:d?a", "tum:d?=1",
                           "tum:d?a=", "tum:d?a=1&a=2", "tum:d?a=1&&b=2"}) {
    const auto uri = parse_source_uri(text);
    ASSERT_FALSE(uri) << text;
    EXPECT_EQ(uri.error().code, ErrorCode::kUsage);
  }
}

TEST(SourceUri, UnknownOptionListsTheValidOnes) {
  const auto uri = parse_source_uri("v4l2:/dev/video0?sise=1x1");
  const auto status = uri->check_options({"size", "fps"});
  ASSERT_FALSE(status);
  EXPECT_THAT(status.error().message, ::testing::AllOf(HasSubstr("'sise'"), HasSubstr("size, fps")));
  EXPECT_TRUE(uri->check_options({"sise"}));
}

TEST(SourceUri, NumbersArePositiveOrAnError) {
  const auto uri = parse_source_uri("images:d?a=12.5&b=0&c=-1&d=x");
  EXPECT_EQ(*uri->positive_number("a", 1), 12.5);
  EXPECT_EQ(*uri->positive_number("none", 30), 30);
  for (const auto* key : {"b", "c", "d"}) EXPECT_FALSE(uri->positive_number(key, 1)) << key;
}

}  // namespace
}  // namespace cairn
