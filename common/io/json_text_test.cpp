// SPDX-License-Identifier: Apache-2.0
#include "common/io/json_text.h"

#include <gmock/gmock.h>

namespace cairn {
namespace {

TEST(PathInJson, IsItselfWhereItIsAText) {
  for (const auto* path : {"a/b.json", "/tmp/K\u00fcche 1%", "a\\xe9", "100%E9"})
    EXPECT_EQ(path_in_json(path), path);
}

TEST(PathInJson, OfOtherBytesIsTheUriThatHasThem) {
  EXPECT_EQ(path_in_json("/tmp/caf\xe9"), "file:///tmp/caf%E9");
  EXPECT_EQ(path_in_json("/t 1%/\xff"), "file:///t%201%25/%FF");
  EXPECT_EQ(path_in_json("/a\u202eb"), "file:///a%E2%80%AEb");
  EXPECT_EQ(path_in_json("/a\nb"), "file:///a%0Ab");
}

TEST(PathInJson, ARelativePathIsNotTakenForAUriNorMadeARelativeOne) {
  const std::string here = path_in_json(std::filesystem::current_path());
  EXPECT_EQ(path_in_json("file:///x"), "file://" + here + "/file%3A///x");
  EXPECT_EQ(path_in_json("\xe9"), "file://" + here + "/%E9");
}

TEST(JsonText, IsValidWhateverBytesThereAre) {
  for (const std::string text : {"caf\xe9", "\xff\xfe", "a\xf0\x9f", "\n\"\\"}) {
    const nlohmann::json json{{"text", text}, {"path", path_in_json(text)}};
    EXPECT_TRUE(nlohmann::json::accept(json_text(json)));
    EXPECT_TRUE(nlohmann::json::accept(json_ascii(json)));
  }
}

}  // namespace
}  // namespace cairn
