// SPDX-License-Identifier: Apache-2.0
#include "server/service/site_access.h"

#include <utility>

#include "common/base/utc.h"
#include "server/access/rights_file.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

constexpr const char* kFile = "site.db";
constexpr size_t kMostWaiting = 10'000;      ///< entries of the audit log that the disk has not taken yet
constexpr int64_t kEntriesKept = 1'000'000;  ///< 200 MB: decades of what people do by hand

struct Opened {
  SiteFile file;
  std::optional<Rights> rights;            ///< nothing: none were ever kept
  std::optional<Timestamp> secured_since;  ///< nothing: it is an open site's
};

Result<Opened> open_file(const fs::path& path) {
  auto file = SiteFile::open(path);
  if (!file) return tl::unexpected(file.error());
  const auto text = file->rights();
  if (!text) return tl::unexpected(text.error());
  const auto since = file->secured_since();
  if (!since) return tl::unexpected(since.error());
  Opened opened{std::move(*file), std::nullopt, *since};
  if (!*text) return opened;
  auto rights = read_rights(**text);
  if (!rights) return tl::unexpected(rights.error());
  opened.rights = std::move(*rights);
  return opened;
}

Rights rights_at_first(SiteKind kind) {
  const bool is_open = kind == SiteKind::kOpen;
  return {is_open ? Right::kWrite : Right::kNone, is_open};
}

/// Whoever was let in by a name that he chose himself would be let in for good.
tl::unexpected<Error> refuse_to_open(const fs::path& path, Timestamp since) {
  return fail(
      ErrorCode::kConfiguration,
      path.string() + ": the store is of a secured site since " + to_utc(since) +
          ", and without --security everybody could do there what its rights allow to any name; start "
          "the server with --security DIR (`cairnctl keys issue server` makes it). Its maps can be "
          "given to an open site: `cairnctl maps export` there, `cairnctl maps import` here");
}

/// Whether a file that is damaged elsewhere can say that it is no secured site's.
bool is_surely_open(const fs::path& path) {
  auto file = SiteFile::open(path);
  if (!file) return false;
  const auto since = file->secured_since();
  return since && !*since;
}

/// Kept before anybody is served.
Status secure(Opened* opened, Timestamp now, const Logger& log) {
  const bool was_open = opened->rights.has_value();
  Rights rights = opened->rights.value_or(rights_at_first(SiteKind::kSecured));
  const size_t before = rights.table().grants.size();
  rights.close_to_unnamed();
  const size_t left = rights.table().grants.size();
  const std::string what = "default: none, makes no maps; " + std::to_string(before - left) +
                           " grants to everyone and to makers of maps withdrawn, " + std::to_string(left) +
                           " to named clients and groups left";
  const AuditEntry entry{0, now, "server", "site secured", {}, what};
  if (Status kept = opened->file.keep_secured(to_text(rights), entry); !kept) return kept;
  opened->rights = std::move(rights);
  opened->secured_since = now;
  if (was_open)
    log->warn(
        "the store was an open site's and is a secured one's from now on: {}; `cairnctl rights` shows them",
        what);
  return {};
}

/// The part of a fingerprint that a person can compare.
std::string short_of(const std::string& fingerprint) {
  return fingerprint.substr(0, 16);
}

/// Moves a file out of the way. Returns the path under which it is kept.
fs::path set_aside(const fs::path& path, Timestamp now) {
  fs::path aside = path.parent_path() / "damaged" / ("site-" + std::to_string(now.nanoseconds) + ".db");
  std::error_code ignored;
  fs::create_directories(aside.parent_path(), ignored);
  for (const char* companion : {"", "-wal", "-shm"})
    fs::rename(path.string() + companion, aside.string() + companion, ignored);
  return aside;
}

}  // namespace

Result<std::unique_ptr<SiteAccess>> SiteAccess::open(const fs::path& folder, SiteKind kind, Clock clock,
                                                     const Logger& log) {
  const Timestamp now = clock();
  const auto make = [&](const Rights& rights, std::shared_ptr<SiteFile> file,
                        std::optional<Timestamp> secured_since, std::string trouble) {
    auto policy = std::make_shared<RightsPolicy>(rights, clock);
    return std::unique_ptr<SiteAccess>(new SiteAccess(std::move(policy), std::move(file), secured_since,
                                                      std::move(trouble), log));  // NOLINT: private
  };
  if (folder.empty()) return make(rights_at_first(kind), nullptr, {}, {});
  const fs::path path = folder / kFile;
  auto opened = open_file(path);
  if (!opened && opened.error().code != ErrorCode::kDamaged) return tl::unexpected(opened.error());
  std::string trouble;
  if (!opened) {
    const std::string why = opened.error().message;
    if (kind == SiteKind::kOpen && !is_surely_open(path)) {
      return fail(ErrorCode::kDamaged,
                  why +
                      "; whether the store is a secured site's is not known. If it is, start the server with "
                      "--security DIR; if it is an open site's, move " +
                      path.string() + " away: its rights and its audit log go with it");
    }
    const fs::path aside = set_aside(path, now);
    opened = open_file(path);
    if (!opened) return tl::unexpected(opened.error());
    // Open to all until somebody notices would be the worse mistake.
    opened->rights = Rights(Right::kNone, false);
    const AuditEntry entry{0, now, "server", "rights closed", {}, why};
    if (Status kept = opened->file.keep_rights(to_text(*opened->rights), entry); !kept)
      return tl::unexpected(kept.error());
    trouble = "the rights could not be read and lie in " + aside.string() +
              "; nobody may do anything until `cairnctl rights` says who may";
    log->error("{}: {}", why, trouble);
  }
  if (kind == SiteKind::kOpen && opened->secured_since) return refuse_to_open(path, *opened->secured_since);
  if (kind == SiteKind::kSecured && !opened->secured_since) {
    if (Status secured = secure(&*opened, now, log); !secured) return tl::unexpected(secured.error());
  }
  return make(opened->rights.value_or(rights_at_first(kind)),
              std::make_shared<SiteFile>(std::move(opened->file)), opened->secured_since, std::move(trouble));
}

Status SiteAccess::know_authority(const std::string& fingerprint) {
  if (file_ == nullptr) return {};
  const auto before = file_->authority();
  if (!before) {
    if (before.error().code != ErrorCode::kDamaged) return tl::unexpected(before.error());
    const std::string what = before.error().message + "; taken to be " + short_of(fingerprint);
    log_->warn("with whose keys the store was used last cannot be read: {}", what);
    return file_->keep_authority(fingerprint,
                                 AuditEntry{0, policy_->now(), "server", "keys unknown", {}, what});
  }
  if (*before == fingerprint) return {};
  if (!*before) return file_->keep_authority(fingerprint, std::nullopt);
  const std::string what = "keys of another authority (" + short_of(fingerprint) +
                           ") than the one that it was "
                           "last used with (" +
                           short_of(**before) + ")";
  log_->warn(
      "the store belongs to another site: it is started with {}. Its rights hold for whoever has the same "
      "names here. `cairnctl rights` shows them, and `cairnctl rights revoke` takes grants back. If this is "
      "the same site on another machine, start the server with the security folder that it had, and use the "
      "keys that there are, instead of `cairnctl keys init` (deploy/SECURED.md, On another machine)",
      what);
  return file_->keep_authority(fingerprint, AuditEntry{0, policy_->now(), "server", "other keys", {}, what});
}

void SiteAccess::know_clients(std::optional<GroupsOfClients> clients) {
  if (clients_ == clients) return;
  clients_ = std::move(clients);
  has_other_groups_ = true;
  newest_.set_groups_of_keys(clients_.value_or(GroupsOfClients{}));
  put_in_force(policy_->rights());
}

/// Puts rights in force, with the groups of the keys as they are now: these may have changed while the rights
/// were kept.
void SiteAccess::put_in_force(Rights rights) {
  rights.set_groups_of_keys(clients_.value_or(GroupsOfClients{}));
  next_expiry_ = rights.next_expiry(policy_->now());
  policy_->put(std::move(rights));
}

void SiteAccess::put(RightsChange change, std::function<void(const Status& kept)> done) {
  newest_ = change.rights;
  if (file_ == nullptr) {
    put_in_force(change.rights);
    return done({});
  }
  const auto keep = [this, file = file_, chain = chain_, change = std::move(change), done = std::move(done)] {
    Status kept = fail(ErrorCode::kIo, "a change of rights before this one could not be kept; ask again");
    if (!chain->is_broken) kept = file->keep_rights(to_text(change.rights), change.entry);
    chain->is_broken = !kept;
    executors_->service([this, kept, chain, rights = change.rights, done] {
      if (kept) {
        put_in_force(rights);
        trouble_.clear();
      } else if (chain == chain_) {
        chain_ = std::make_shared<Chain>();
        newest_ = policy_->rights();
      }
      tell_of_disk(kept);
      done(kept);
    });
  };
  executors_->site.submit(keep, Urgency::kUrgent);
}

void SiteAccess::let_maker_write(const std::string& client, const MapId& map, const std::string& map_name,
                                 std::function<void(const Status& kept)> done) {
  const Timestamp now = policy_->now();
  RightsChange change{newest_,
                      {0, now, "server", "rights grant",
                       "client " + client + ", map " + map_name + ": write, as its maker", "done"}};
  if (Status granted = change.rights.let_maker_write(client, map, now); !granted) return done(granted);
  put(std::move(change), std::move(done));
}

void SiteAccess::forget(const MapId& map, const std::string& map_name) {
  RightsChange change{
      newest_, {0, policy_->now(), "server", "rights revoke", "map " + map_name + ", which is gone", "done"}};
  change.rights.forget(map);
  if (change.rights.table() == newest_.table()) return;
  put(std::move(change), [log = log_, map_name](const Status& kept) {
    if (!kept) log->error("rights in {}, which is gone, are still there: {}", map_name, kept.error().message);
  });
}

void SiteAccess::note(AuditEntry entry) {
  if (file_ == nullptr) return;
  keep_entries([entry = std::move(entry)](std::vector<AuditEntry>* waiting) { waiting->push_back(entry); });
}

void SiteAccess::keep_entries(std::function<void(std::vector<AuditEntry>* waiting)> add) {
  is_keeping_ = true;
  kept_last_ = policy_->now();
  const auto write = [this, file = file_, waiting = waiting_, log = log_, add = std::move(add)] {
    add(waiting.get());
    const Status written = file->append(*waiting);
    if (written) {
      waiting->clear();
    } else if (waiting->size() > kMostWaiting) {
      const AuditEntry& lost = waiting->front();
      log->error("an entry of the audit log is lost: {} {} {} {}", lost.who, lost.action, lost.object,
                 lost.outcome);
      waiting->erase(waiting->begin());
    }
    if (const auto pruned = file->prune(kEntriesKept); written && !pruned)
      log->error("the audit log: {}", pruned.error().message);
    executors_->service([this, written] {
      is_keeping_ = false;
      tell_of_disk(written);
    });
  };
  executors_->site.submit(write, Urgency::kUrgent);  // in the order in which it was done
}

void SiteAccess::tell_of_disk(const Status& written) {
  const bool was_well = disk_trouble_.empty();
  disk_trouble_ = written ? std::string() : "rights and audit log cannot be kept: " + written.error().message;
  if (!written && was_well) log_->error("{}", disk_trouble_);
  if (written && !was_well) log_->info("rights and audit log can be kept again");
}

void SiteAccess::try_again() {
  constexpr int64_t kPause = 2'000'000'000;  // [ns]
  if (disk_trouble_.empty() || is_keeping_ || policy_->now().nanoseconds - kept_last_.nanoseconds < kPause)
    return;
  // Where nothing waits (a change of rights was refused), only an entry can show that the disk takes one.
  keep_entries([now = policy_->now()](std::vector<AuditEntry>* waiting) {
    if (waiting->empty()) waiting->push_back({0, now, "server", "kept again", {}, "rights and audit log"});
  });
}

std::string SiteAccess::trouble() const {
  return trouble_.empty() || disk_trouble_.empty() ? trouble_ + disk_trouble_
                                                   : trouble_ + "; " + disk_trouble_;
}

void SiteAccess::note_refused(const std::string& who, const std::string& why) {
  log_->warn("{} was not let in: {}", who, why);
  note({0, policy_->now(), who, "not let in", {}, why});
}

void SiteAccess::note_turned_away(const Principal& who, const std::string& why) {
  const bool is_client = who.kind == Principal::Kind::kClient;
  const std::string object = (is_client ? "client " : "operator ") + who.name;
  log_->warn("{} is turned away: {}", object, why);
  note({0, policy_->now(), object, "turned away", {}, why});
}

void SiteAccess::find(AuditQuery query, std::function<void(Result<std::vector<AuditEntry>> found)> done) {
  if (file_ == nullptr)
    return done(fail(ErrorCode::kRefused, "this server has no --store: it keeps no audit log"));
  executors_->site.submit([this, file = file_, query = std::move(query), done = std::move(done)] {
    auto found = file->find(query);
    executors_->service([found = std::move(found), done] { done(found); });
  });
}

bool SiteAccess::has_changed() {
  const Timestamp now = policy_->now();
  const bool has_other_groups = std::exchange(has_other_groups_, false);
  if (!next_expiry_ || *next_expiry_ > now) return has_other_groups;
  next_expiry_ = policy_->rights().next_expiry(now);
  return true;
}

}  // namespace cairn
