// SPDX-License-Identifier: Apache-2.0
// Messages that are serialized once for the partitions of many clients.
#include "common/wire/serialized_writer.h"

#include <gtest/gtest.h>

#include "common/wire/internal/serialized_sample.h"
#include "common/wire/repeated_bytes.h"
#include "common/wire/wire_fixture.h"

namespace cairn::wire {
namespace {

constexpr size_t kClients = 5;

std::string partition(size_t client) {
  return "client." + std::to_string(client) + ".map.x";
}

class SerializedWriterTest : public WireTest {
 protected:
  template <typename Message>
  std::vector<SerializedWriter<Message>> writers(const Participant& participant) {
    std::vector<SerializedWriter<Message>> made;
    for (size_t i = 0; i < kClients; ++i)
      made.push_back(SerializedWriter<Message>::create(participant, partition(i)).value());
    return made;
  }
  /// Readers are there before or come after it was written and our own reference has gone.
  template <typename Message>
  void expect_to_arrive_everywhere(const Participant& server, const Participant& client, bool are_there) {
    auto writers = this->writers<Message>(server);
    std::vector<Reader<Message>> readers;
    const auto join = [&] {
      for (size_t i = 0; i < kClients; ++i) readers.push_back(reader<Message>(client, partition(i)));
      return eventually(
          [&] { return std::ranges::all_of(writers, [](auto& to) { return to.matched() == 1; }); });
    };
    ASSERT_TRUE(!are_there || join());
    const auto sent = random_.make<Message>();
    {
      const auto serialized = writers.back().serialize(sent);
      ASSERT_TRUE(serialized) << serialized.error().message;
      for (auto& to : writers) {
        ASSERT_TRUE(to.write(*serialized));
        to.flush();
      }
    }
    ASSERT_TRUE(are_there || join());
    for (auto& from : readers) {
      const auto got = collect(&from, 1);
      ASSERT_EQ(got.size(), 1U);
      ASSERT_TRUE(got[0].message);
      EXPECT_TRUE(testing::same(*got[0].message, sent));
    }
  }
};

TEST_F(SerializedWriterTest, WhatIsSerializedOnceArrivesInEveryPartition) {
  const Participant server = this->server();
  const Participant client = this->client();
  for (const bool are_there : {true, false}) {
    expect_to_arrive_everywhere<PointPatches>(server, client, are_there);
    expect_to_arrive_everywhere<PointPositions>(server, client, are_there);
    expect_to_arrive_everywhere<KeyframePoses>(server, client, are_there);
  }
}

/// As often as it takes until something has been lost: blocks share datagrams, so that few of them travel.
TEST_F(SerializedWriterTest, WhatIsLostOnTheWayToOneIsRepeatedToIt) {
  const Participant server = this->server(200);
  const Participant client = this->client(200);
  constexpr uint32_t kBlocks = 20;
  auto writers = this->writers<PointPositions>(server);
  std::vector<Reader<PointPositions>> readers;
  for (size_t i = 0; i < kClients; ++i) readers.push_back(reader<PointPositions>(client, partition(i)));
  ASSERT_TRUE(
      eventually([&] { return std::ranges::all_of(writers, [](auto& to) { return to.matched() == 1; }); }));
  for (int round = 0; round < kMostRounds && repeated_bytes(server) == 0; ++round) {
    std::vector<PointPositions> sent;
    for (uint32_t index = 0; index < kBlocks; ++index) {
      sent.push_back(random_.make<PointPositions>());
      sent.back().map = MapId{{static_cast<uint8_t>(1 + round)}};
      sent.back().block.index = index;
      const auto serialized = writers[0].serialize(sent.back()).value();
      for (auto& to : writers) ASSERT_TRUE(to.write(serialized));
    }
    for (auto& to : writers) to.flush();
    for (auto& from : readers) {
      const auto got = collect(&from, kBlocks);
      ASSERT_EQ(got.size(), kBlocks);
      for (const auto& sample : got)
        EXPECT_TRUE(testing::same(*sample.message, sent[sample.message->block.index]));
    }
  }
  EXPECT_GT(repeated_bytes(server), 0U) << "nothing was lost";
}

/// Of small blocks that are written at once the last stay with the writer, and no reader hears of them.
TEST_F(SerializedWriterTest, WhatIsFlushedArrivesThoughNothingComesAfterIt) {
  const Participant server = this->server();
  const Participant client = this->client();
  auto to = SerializedWriter<KeyframePoses>::create(server, partition(0)).value();
  auto from = reader<KeyframePoses>(client, partition(0));
  ASSERT_TRUE(eventually([&] { return to.matched() == 1; }));
  for (size_t blocks = 1; blocks <= 8; ++blocks) {
    SCOPED_TRACE(::testing::Message() << blocks << " blocks at once");
    for (size_t i = 0; i < blocks; ++i)
      ASSERT_TRUE(to.write(to.serialize(random_.make<KeyframePoses>()).value()));
    to.flush();
    ASSERT_EQ(collect(&from, blocks).size(), blocks);
  }
}

TEST_F(SerializedWriterTest, TheMiddlewareKeepsOneCopyForAllPartitions) {
  const Participant server = this->server();
  auto writers = this->writers<PointPatches>(server);
  auto block = random_.make<PointPatches>();
  const auto first = writers[0].serialize(block).value();
  for (auto& to : writers) ASSERT_TRUE(to.write(first));
  const auto references = [](const auto& serialized) {
    return ddsrt_atomic_ld32(&serialized.sample->data()->refc);
  };
  EXPECT_EQ(references(first), 1 + kClients);
  // A newer version takes its place, and what nobody needs any more goes.
  ++block.block.version;
  const auto second = writers[1].serialize(block).value();
  for (auto& to : writers) ASSERT_TRUE(to.write(second));
  EXPECT_EQ(references(first), 1U);
  EXPECT_EQ(references(second), 1 + kClients);
}

TEST_F(SerializedWriterTest, WhatAnotherParticipantHasSerializedIsRefused) {
  const Participant server = this->server();
  const Participant other = this->client();
  const auto theirs = SerializedWriter<PointPatches>::create(other, partition(0)).value();
  const auto serialized = theirs.serialize(random_.make<PointPatches>()).value();
  auto ours = SerializedWriter<PointPatches>::create(server, partition(0)).value();
  const Status written = ours.write(serialized);
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().code, ErrorCode::kInternal);
}

TEST_F(SerializedWriterTest, WhatIsSerializedOutlivesItsWriterAndItsParticipant) {
  Serialized<PointPatches> kept;
  {
    const Participant server = this->server();
    kept = SerializedWriter<PointPatches>::create(server, partition(0))
               .value()
               .serialize(random_.make<PointPatches>())
               .value();
  }
  EXPECT_EQ(ddsrt_atomic_ld32(&kept.sample->data()->refc), 1U);
}

}  // namespace
}  // namespace cairn::wire
