// SPDX-License-Identifier: Apache-2.0
// Attacks on a secured site, over the real middleware, with keys that the product itself has made. Whoever
// attacks knows the discovery tag: what refuses is what comes after it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/base_sink.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/io/test_directory.h"
#include "common/io/text.h"
#include "common/wire/partition.h"
#include "common/wire/security.h"
#include "common/wire/wire_fixture.h"
#include "server/keys/keystore.h"
#include "server/keys/permissions.h"

namespace cairn::wire {
namespace {

namespace fs = std::filesystem;
using std::chrono::hours;
using std::chrono::seconds;
using ::testing::HasSubstr;

/// In which a handshake is over, by far; who is not matched then is not.
constexpr std::chrono::milliseconds kRefusalTime{2500};

/// Lines, for whoever asks.
class LineSink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  bool has(const std::string& part) {
    const std::lock_guard lock(mutex_);
    for (const std::string& line : lines_)
      if (line.find(part) != std::string::npos) return true;
    return false;
  }
  std::string all() {
    const std::lock_guard lock(mutex_);
    std::string text;
    for (const std::string& line : lines_) text += line + "\n";
    return text;
  }

 private:
  void sink_it_(const spdlog::details::log_msg& message) override {
    lines_.emplace_back(message.payload.data(), message.payload.size());
  }
  void flush_() override {}
  std::vector<std::string> lines_;
};

/// A site with a server that hears KeyframeOffer and TrackerState of every client, and says MapInfo to the
/// clients phone-1 and phone-2.
class SecuredSite : public ::testing::Test {
 protected:
  void SetUp() override {
    make_site(keys_);
    server_keys_ = issue(keys_, IdentityRole::kServer, "server");
    start_server();
  }

  static void make_site(const fs::path& keys) {
    const Status made = Keystore::init(keys, wall_clock_now());
    ASSERT_TRUE(made) << made.error().message;
  }
  static fs::path issue(const fs::path& keys, IdentityRole role, const std::string& name,
                        seconds valid_for = hours(24)) {
    Identity wanted;
    wanted.role = role;
    wanted.name = name;
    return Keystore::open(keys).value().issue(wanted, valid_for, wall_clock_now()).value();
  }
  void start_server() {
    ParticipantOptions options;
    options.role = Role::kServer;
    options.security = server_keys_;
    for (uint32_t i = 0; i < kDomains && !server_; ++i) {
      options.domain = 5 + (static_cast<uint32_t>(getpid()) * 7 + i) % kDomains;
      auto made = Participant::create(options);
      if (!made && made.error().code != ErrorCode::kRefused)
        throw std::runtime_error(made.error().message + "\n" + lines_->all());
      if (made) server_ = *std::move(made);
    }
    domain_ = options.domain;
    offers_ = reader<KeyframeOffer>(*server_, kEveryClient);
    states_ = reader<TrackerStateMessage>(*server_, kEveryClient);
    for (const char* name : {"phone-1", "phone-2"}) {
      maps_.push_back(writer<MapInfo>(*server_, client_partition(name)));
      ASSERT_TRUE(maps_.back().write(random_.make<MapInfo>()));
    }
  }
  void stop_server() {
    maps_.clear();
    states_.reset();
    offers_.reset();
    server_.reset();
  }

  Result<Participant> join(const fs::path& security) const {
    ParticipantOptions options;
    options.domain = domain_;
    options.security = security;
    return Participant::create(options);
  }
  /// Whether the server hears what it writes.
  bool is_heard(const Participant& who, const std::string& name) {
    auto to_server = writer<KeyframeOffer>(who, client_partition(name));
    if (!eventually([&] { return offers_->matched() > 0; }, kRefusalTime)) return false;
    return to_server.write(random_.make<KeyframeOffer>()) && collect(&*offers_, 1).size() == 1;
  }
  /// Nothing goes either way, though both are there for the whole time.
  void expect_nothing_passes(const Participant& attacker) {
    auto written = writer<KeyframeOffer>(attacker, "client.phone-1");
    auto read = reader<MapInfo>(attacker, "client.phone-1");
    const auto end = std::chrono::steady_clock::now() + kRefusalTime;
    while (std::chrono::steady_clock::now() < end) {
      (void)written.write(random_.make<KeyframeOffer>());
      ASSERT_EQ(offers_->matched(), 0);
      ASSERT_TRUE(offers_->take().empty());
      ASSERT_TRUE(read.take().empty());
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  std::string tag() const { return read_security(server_keys_).value().tag; }
  /// So that it is not the tag that keeps it out.
  void give_tag(const fs::path& security) const { std::ofstream(security / "tag") << tag() << '\n'; }

  const std::shared_ptr<LineSink> lines_ = std::make_shared<LineSink>();
  const LogRedirect redirect_{std::make_shared<spdlog::logger>("test", lines_), 1000};
  const TestDirectory directory_;
  const fs::path keys_ = directory_.path() / "keys";
  fs::path server_keys_;
  testing::RandomMessages random_{kSeed};
  uint32_t domain_ = 0;
  std::optional<Participant> server_;
  std::optional<Reader<KeyframeOffer>> offers_;
  std::optional<Reader<TrackerStateMessage>> states_;
  std::vector<Writer<MapInfo>> maps_;
};

TEST_F(SecuredSite, AClientIsHeardAndHearsWhatIsForIt) {
  const auto phone = join(issue(keys_, IdentityRole::kClient, "phone-1"));
  ASSERT_TRUE(phone) << phone.error().message;
  EXPECT_TRUE(is_heard(*phone, "phone-1")) << lines_->all();
  auto maps = reader<MapInfo>(*phone, "client.phone-1");
  EXPECT_EQ(collect(&maps, 1).size(), 1U) << lines_->all();
  EXPECT_EQ(lines_->all(), "");
}

// The server makes a client's writers while it learns of that client's readers. Where samples alone are
// encrypted, Cyclone 0.10 then gives some reader the keys of a writer twice, and who has them twice before it
// knows the writer crashes (its list of keys that wait for their writer has one of them twice).
TEST_F(SecuredSite, WhoComesWhileItsWritersAreMadeHasTheKeysOfEachOnce) {
  constexpr int kRounds = 4, kReaders = 16, kWriters = 40;
  const fs::path keys = issue(keys_, IdentityRole::kClient, "phone-1");
  for (int round = 0; round < kRounds; ++round) {
    const auto phone = join(keys);
    ASSERT_TRUE(phone) << phone.error().message;
    std::vector<Reader<MapInfo>> readers;
    for (int i = 0; i < kReaders; ++i) readers.push_back(reader<MapInfo>(*phone, "client.phone-1"));
    std::vector<Writer<MapInfo>> writers;
    const auto made_one = [&] {
      writers.push_back(writer<MapInfo>(*server_, "client.phone-1"));
      return writers.size() >= kWriters && maps_.front().matched() == kReaders;
    };
    ASSERT_TRUE(eventually(made_one)) << lines_->all();
    const auto have_all = [&] {
      return std::ranges::all_of(
          readers, [&](const auto& each) { return each.matched() == static_cast<int>(writers.size()) + 1; });
    };
    EXPECT_TRUE(eventually(have_all)) << lines_->all();
  }
}

TEST_F(SecuredSite, NobodyJoinsWithoutACertificate) {
  ParticipantOptions options;
  options.domain = domain_;
  options.tag = tag() + "." + options.tag;
  expect_nothing_passes(Participant::create(options).value());
}

TEST_F(SecuredSite, ACertificateOfAnotherSiteIsRefused) {
  const fs::path other = directory_.path() / "other";
  make_site(other);
  const fs::path keys = issue(other, IdentityRole::kClient, "phone-1");
  give_tag(keys);
  expect_nothing_passes(join(keys).value());
  EXPECT_TRUE(lines_->has("unable to get local issuer certificate; subject: /O=cairn/OU=client/CN=phone-1"))
      << lines_->all();
}

TEST_F(SecuredSite, PermissionsThatAClientHasSignedItselfAreRefused) {
  const fs::path keys = issue(keys_, IdentityRole::kClient, "mallory");
  const KeyPair own{read_private_key(keys / "key.pem").value(), read_certificate(keys / "cert.pem").value()};
  Identity wanted;
  wanted.name = "phone-1";  // whose partitions it would like
  const Validity validity{facts_of(*own.certificate).begins, facts_of(*own.certificate).expires};
  const std::string text = make_permissions(wanted, subject_of(*own.certificate), validity);
  std::ofstream(keys / "permissions.p7s") << sign_document(own, text).value();
  // Its own software, like ours, says what is wrong.
  const auto joined = join(keys);
  ASSERT_FALSE(joined);
  EXPECT_THAT(joined.error().message, HasSubstr("permissions.p7s: not signed by its authority"));

  // A software that is told to trust an authority of the attacker's does not, and the server does not either.
  const KeyPair authority = make_authority("mallory", Signs::kDocuments, validity).value();
  std::ofstream(keys / "permissions_ca.cert.pem") << to_pem(*authority.certificate).value();
  std::ofstream(keys / "permissions.p7s") << sign_document(authority, text).value();
  std::ofstream(keys / "governance.p7s") << sign_document(authority, make_governance()).value();
  const auto attacker = join(keys);
  ASSERT_TRUE(attacker) << attacker.error().message;
  expect_nothing_passes(*attacker);
  EXPECT_TRUE(lines_->has("permissions from plugin")) << lines_->all();
}

TEST_F(SecuredSite, WhoseKeysExpireIsGoneAtThatMoment) {
  const auto phone = join(issue(keys_, IdentityRole::kClient, "phone-1", seconds(6)));
  ASSERT_TRUE(phone) << phone.error().message;
  const auto offers = writer<KeyframeOffer>(*phone, "client.phone-1");
  ASSERT_TRUE(eventually([&] { return offers_->matched() == 1; })) << lines_->all();
  EXPECT_TRUE(eventually([&] { return offers_->matched() == 0; })) << lines_->all();
  const auto again = join(Keystore::open(keys_).value().security_folder(IdentityRole::kClient, "phone-1"));
  ASSERT_FALSE(again);
  EXPECT_THAT(again.error().message, HasSubstr("cert.pem: has expired"));
}

TEST_F(SecuredSite, WhoIsRevokedIsRefusedByAServerThatStartsAnew) {
  const fs::path keys = issue(keys_, IdentityRole::kClient, "phone-1");
  const fs::path copied = directory_.path() / "phone";  // as on the device
  fs::copy(keys, copied);
  {
    const auto phone = join(copied);
    ASSERT_TRUE(phone) << phone.error().message;
    ASSERT_TRUE(is_heard(*phone, "phone-1")) << lines_->all();
  }
  ASSERT_TRUE(Keystore::open(keys_).value().revoke(IdentityRole::kClient, "phone-1", wall_clock_now()));
  stop_server();
  start_server();
  expect_nothing_passes(join(copied).value());
  EXPECT_TRUE(lines_->has("certificate revoked; subject: /O=cairn/OU=client/CN=phone-1")) << lines_->all();
}

TEST_F(SecuredSite, AClientCanNeitherWriteNorReadAsAnother) {
  const auto phone = join(issue(keys_, IdentityRole::kClient, "phone-1"));
  ASSERT_TRUE(phone) << phone.error().message;
  for (const char* partition :
       {"client.phone-2", "client.*", "*", "", "client.phone-1.map.x", "client.phone-?"}) {
    const auto written = Writer<KeyframeOffer>::create(*phone, partition);
    ASSERT_FALSE(written) << partition;
    EXPECT_EQ(written.error().code, ErrorCode::kRefused) << partition;
    EXPECT_FALSE(Reader<MapInfo>::create(*phone, partition)) << partition;
  }
  for (const char* partition : {"client.phone-2.map.*", "client.*", "*.map.*"})
    EXPECT_FALSE(Reader<MapCommit>::create(*phone, partition)) << partition;
}

TEST_F(SecuredSite, AClientCannotWriteWhatTheServerSays) {
  const auto phone = join(issue(keys_, IdentityRole::kClient, "phone-1"));
  ASSERT_TRUE(phone) << phone.error().message;
  EXPECT_FALSE(Writer<MapInfo>::create(*phone, "client.phone-1"));
  EXPECT_FALSE(Writer<MapCommit>::create(*phone, "client.phone-1.map.x"));
  EXPECT_FALSE(Writer<AdminRequest>::create(*phone, "operator.phone-1"));
  EXPECT_FALSE(Reader<KeyframeOffer>::create(*phone, "client.phone-1"));
  EXPECT_TRUE(is_heard(*phone, "phone-1")) << "goes on working";
}

TEST_F(SecuredSite, KeysOfAnotherRoleAreRefusedBeforeJoining) {
  ParticipantOptions options;
  options.domain = domain_ == 5 ? 6 : 5;
  options.role = Role::kServer;
  options.security = issue(keys_, IdentityRole::kClient, "phone-1");
  const auto made = Participant::create(options);
  ASSERT_FALSE(made);
  EXPECT_THAT(made.error().message, HasSubstr("of client phone-1; those of a server are needed"));
}

TEST_F(SecuredSite, WhatIsWrongWithAFolderIsNamed) {
  const fs::path keys = issue(keys_, IdentityRole::kClient, "phone-1");
  const auto error_of = [&] {
    const auto read = read_security(keys);
    return read ? "good" : read.error().message;
  };
  EXPECT_EQ(error_of(), "good");
  EXPECT_EQ(secured_name(keys, "client", "").value(), "phone-1");
  EXPECT_THAT(secured_name(keys, "client", "phone-2").error().message,
              HasSubstr("of client phone-1, not of phone-2"));
  EXPECT_THAT(secured_name(keys, "server", "").error().message, HasSubstr("`cairnctl keys issue server`"));
  fs::permissions(keys / "key.pem", fs::perms::group_read, fs::perm_options::add);
  EXPECT_THAT(error_of(), HasSubstr("key.pem: others can read it; `chmod 600`"));
  fs::permissions(keys / "key.pem", fs::perms::owner_read | fs::perms::owner_write);
  for (const char* file : {"identity_ca.cert.pem", "permissions_ca.cert.pem", "cert.pem", "key.pem",
                           "governance.p7s", "permissions.p7s", "tag", "crl.pem"}) {
    const std::string good = read_file(keys / file).value();
    for (const std::string& bad : {std::string(), std::string("rubbish"), good.substr(0, good.size() / 2)}) {
      std::ofstream(keys / file) << bad;
      EXPECT_THAT(error_of(), HasSubstr((keys / file).string())) << bad;
    }
    fs::remove(keys / file);
    EXPECT_THAT(error_of(), HasSubstr((keys / file).string()));
    std::ofstream(keys / file) << good;
    fs::permissions(keys / file, fs::perms::owner_read | fs::perms::owner_write);
    EXPECT_EQ(error_of(), "good");
  }
  const fs::path copied = directory_.path() / "phone";  // as on the device, to which the new list comes
  fs::copy(keys, copied);
  ASSERT_TRUE(Keystore::open(keys_).value().revoke(IdentityRole::kClient, "phone-1", wall_clock_now()));
  EXPECT_TRUE(read_security(copied)) << "it has not come yet";
  fs::copy_file(server_keys_ / "crl.pem", copied / "crl.pem", fs::copy_options::overwrite_existing);
  EXPECT_THAT(read_security(copied).error().message, HasSubstr("the keys of client phone-1 were revoked"));
  fs::copy_file(copied / "identity_ca.cert.pem", copied / "permissions_ca.cert.pem",
                fs::copy_options::overwrite_existing);
  EXPECT_THAT(read_security(copied).error().message, HasSubstr("the authority of the identities too"));
}

}  // namespace
}  // namespace cairn::wire
