// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/log.h"
#include "server/access/principal.h"
#include "server/access/rights_policy.h"
#include "server/service/executor.h"
#include "server/service/rights_verbs.h"
#include "server/store/site_file.h"

namespace cairn {

enum class SiteKind : uint8_t {
  kOpen,     ///< names are believed; everybody may write and make maps until an operator says otherwise
  kSecured,  ///< names are proven; nobody may do anything until an operator has said who may
};

/// The rights of a site in force, and its audit log. Rights are kept first and are in force then: what the
/// disk does not take has not happened. Used from the service's thread, but for the file, which is used by
/// the tasks handed to `site` only.
class SiteAccess {
 public:
  struct Executors {
    Executor& site;                     ///< one task at a time; what takes long runs elsewhere
    std::function<void(Task)> service;  ///< on the service's thread, soon
  };
  using Clock = RightsPolicy::Clock;

  /// `folder`: of the store; empty: nothing is kept. A store that was an open site's and is opened as a
  /// secured one is secured for good, and who is not named has no rights there any more, whatever was decided
  /// when nobody had to prove who he was. A file that cannot be read is set aside in the folder `damaged`;
  /// nobody may do anything then until an operator has granted it, also after the next start. Errors: kIo,
  /// kConfiguration (of a newer version; a secured store that is to be opened to everybody).
  [[nodiscard]] static Result<std::unique_ptr<SiteAccess>> open(const std::filesystem::path& folder,
                                                                SiteKind kind, Clock clock,
                                                                const Logger& log);
  /// Notes the fingerprint of the authority that a secured site's keys are of. To be called in a task of
  /// `site`. Where the store was last used with keys of another authority, that is said this once, in the log
  /// (with what to do) and on record. Errors: kDamaged, kIo.
  [[nodiscard]] Status know_authority(const std::string& fingerprint);
  /// Sets the executors. To be called before anything of what follows.
  void run_by(Executors executors) { executors_.emplace(std::move(executors)); }

  [[nodiscard]] const std::shared_ptr<RightsPolicy>& policy() const { return policy_; }
  [[nodiscard]] bool is_kept() const { return file_ != nullptr; }
  /// Since when the store is a secured site's; nothing: it is not, or nothing is kept.
  [[nodiscard]] const std::optional<Timestamp>& secured_since() const { return secured_since_; }
  /// Why nobody may do anything, for the server's health; empty when all is well.
  [[nodiscard]] std::string trouble() const;

  /// Keeps a change and puts it in force; `done` is told on the service's thread. Changes come into force in
  /// their order, before what is asked of the audit log; each is to be made of the newest rights().
  void put(RightsChange change, std::function<void(const Status& kept)> done);
  /// Lets the maker of a map write in it from now on: kept and put in force as by put().
  void let_maker_write(const std::string& client, const MapId& map, const std::string& map_name,
                       std::function<void(const Status& kept)> done);
  /// Forgets a map that is gone for good, and all that was said of it.
  void forget(const MapId& map, const std::string& map_name);
  /// The newest rights, in force or about to be.
  [[nodiscard]] const Rights& rights() const { return newest_; }
  /// Writes an entry into the audit log, soon; what the disk does not take waits until it does.
  void note(AuditEntry entry);
  /// Writes into audit log and server's log that the transport did not let somebody in, by the name that he
  /// gives.
  void note_refused(const std::string& who, const std::string& why);
  /// Writes into both logs that somebody is not heard, or not any more, though he speaks.
  void note_turned_away(const Principal& who, const std::string& why);
  /// Tries to write what waits, now and then; to be called often.
  void try_again();
  /// Finds entries of the audit log. Error kRefused: nothing is kept.
  void find(AuditQuery query, std::function<void(Result<std::vector<AuditEntry>> found)> done);

  /// Sets which clients have keys, and the groups that these name: they count in rights from now on. Nothing:
  /// an open site, where nobody has keys.
  void know_clients(std::optional<GroupsOfClients> clients);
  [[nodiscard]] const std::optional<GroupsOfClients>& clients_with_keys() const { return clients_; }

  /// Whether a ruling may have changed since this was asked last without an operator's word: a grant has
  /// expired, or keys name other groups.
  [[nodiscard]] bool has_changed();

 private:
  SiteAccess(std::shared_ptr<RightsPolicy> policy, std::shared_ptr<SiteFile> file,
             std::optional<Timestamp> secured_since, std::string trouble, Logger log)
      : policy_(std::move(policy)),
        newest_(policy_->rights()),
        file_(std::move(file)),
        secured_since_(secured_since),
        trouble_(std::move(trouble)),
        log_(std::move(log)),
        next_expiry_(newest_.next_expiry(policy_->now())) {}
  void put_in_force(Rights rights);
  /// Keeps the entries that wait, and what `add` adds to them.
  void keep_entries(std::function<void(std::vector<AuditEntry>* waiting)> add);
  void tell_of_disk(const Status& written);

  /// Changes that were each made of the one before: once one is not kept, none after it is. `is_broken` is
  /// used by `site` only.
  struct Chain {
    bool is_broken = false;
  };

  std::shared_ptr<RightsPolicy> policy_;
  Rights newest_;
  std::shared_ptr<Chain> chain_ = std::make_shared<Chain>();
  std::shared_ptr<SiteFile> file_;  ///< used by `site` only; null: nothing is kept
  std::optional<Timestamp> secured_since_;
  std::string trouble_;
  std::string disk_trouble_;  ///< since the last write failed
  bool is_keeping_ = false;   ///< entries of the audit log
  Timestamp kept_last_;
  /// Entries that the disk has not taken; used by `site` only.
  std::shared_ptr<std::vector<AuditEntry>> waiting_ = std::make_shared<std::vector<AuditEntry>>();
  Logger log_;
  std::optional<Executors> executors_;
  std::optional<Timestamp> next_expiry_;
  std::optional<GroupsOfClients> clients_;  ///< that have keys
  bool has_other_groups_ = false;           ///< since has_changed() said so
};

}  // namespace cairn
