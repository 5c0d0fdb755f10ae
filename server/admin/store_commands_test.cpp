// SPDX-License-Identifier: Apache-2.0
#include "server/admin/store_commands.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/store/kept_map_fixture.h"
#include "server/store/sqlite.h"
#include "server/store/store.h"

namespace cairn {
namespace {

using ::testing::HasSubstr;

class VerifyFolder : public testing::KeptMapFixture {
 protected:
  void SetUp() override {
    start();
    auto store = Store::open(folder_ / "store", null_logger());
    ASSERT_TRUE(store) << store.error().message;
    ASSERT_TRUE((*store)->create(header_, take_update()));
    path_ = (*store)->path_of(header_.id);
  }
  void alter(const std::string& sql) {
    auto raw = sqlite::Database::open(path_, sqlite::OpenMode::kReadWrite);
    ASSERT_TRUE(raw);
    const Status altered = raw->execute(sql);
    ASSERT_TRUE(altered) << altered.error().message;
  }
  /// `cairnctl verify --data`: how it ends, and in `said` what it prints.
  [[nodiscard]] Status verify(bool as_json, std::string* said) const {
    CLI::App app;
    AccessAction ask_server;
    LocalAction local;
    describe_store(&app, &ask_server, &local);
    app.parse(std::vector<std::string>{(folder_ / "store").string(), "--data", "verify"});  // from the last
    ::testing::internal::CaptureStdout();
    Status ended = local(as_json);
    *said = ::testing::internal::GetCapturedStdout();
    return ended;
  }

  std::filesystem::path path_;
};

TEST_F(VerifyFolder, ALostProposalIsNamedAndTheRemedyToo) {
  std::string said;
  const Status sound = verify(false, &said);
  EXPECT_TRUE(sound) << sound.error().message << said;
  alter("INSERT INTO proposals(id, data, checksum) VALUES(1, x'00', 0)");
  for (const bool as_json : {false, true}) {
    const Status damaged = verify(as_json, &said);
    ASSERT_FALSE(damaged) << said;
    EXPECT_EQ(damaged.error().code, ErrorCode::kDamaged);
    EXPECT_THAT(said, HasSubstr("table proposals, row 1"));
    EXPECT_THAT(said, HasSubstr("the map is whole without these proposals"));
  }
}

}  // namespace
}  // namespace cairn
