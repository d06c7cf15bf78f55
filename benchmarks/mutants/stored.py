"""What makes a run file safe and honest: durability, one writer, the checks of every reading."""

from mutants.mutant import Mutant

DISK, WRITER, ROWS = "probe/storage/disk.py", "probe/storage/writer.py", "probe/storage/rows.py"
LOCK = "probe/storage/lock.py"
READER, AUDIT = "probe/storage/reader.py", "probe/storage/audit.py"
SCHEMA = "probe/storage/schema.py"
TEST_WRITER = "tests/probe/storage/test_writer.py"
TEST_VERIFY = "tests/probe/storage/test_verify.py"
TEST_RUN = "tests/probe/storage/test_run.py"

STORED = (
    Mutant(
        "writes are not synchronous", DISK,
        'connection.execute("PRAGMA synchronous = FULL")',
        'connection.execute("PRAGMA synchronous = OFF")',
        (f"{TEST_WRITER}::test_safe_modes_are_on_and_said_in_the_file",),
    ),
    Mutant(
        "a mode that SQLite refused is not noticed", DISK,
        "if level != 2:", "if level > 9:",
        ("tests/probe/storage/test_safe_modes.py",),
    ),
    Mutant(
        "no write-ahead log", DISK,
        '"PRAGMA journal_mode = WAL"', '"PRAGMA journal_mode = MEMORY"',
        (f"{TEST_WRITER}::test_safe_modes_are_on_and_said_in_the_file",),
    ),
    Mutant(
        "a missing log is not noticed", DISK,
        'if mode != "wal":', 'if mode == "none":',
        (f"{TEST_WRITER}::test_a_file_system_without_a_log_is_refused",),
    ),
    Mutant(
        "two writers of one run", LOCK,
        "fcntl.LOCK_EX | fcntl.LOCK_NB", "fcntl.LOCK_SH | fcntl.LOCK_NB",
        ("tests/probe/storage/test_safe_modes.py",),
    ),
    Mutant(
        "runs on network file systems", DISK,
        "if kind.startswith(NETWORK):", "if kind in NETWORK[:0]:",
        ("tests/probe/storage/test_disk.py::test_network_file_systems_are_refused",),
    ),
    Mutant(
        "the log grows without end", DISK,
        "LOG_PAGES = 100", "LOG_PAGES = 100_000",
        ("tests/probe/storage/test_safe_modes.py",),
    ),
    Mutant(
        "commits every five seconds", WRITER,
        "COMMIT_S = 0.05", "COMMIT_S = 5.0",
        (f"{TEST_WRITER}::test_a_block_is_committed_in_time",),
    ),
    Mutant(
        "a disk that hangs is waited for", WRITER,
        "        if waits_s > LATE_S:", "        if waits_s > 1e9:",
        ("tests/probe/storage/test_writer.py::test_a_disk_that_hangs_stops_the_scan",),
    ),
    Mutant(
        "the end of a run is not waited for", WRITER,
        "if isinstance(event, RunStarted | RunEnded):\n            self.flush()",
        "if isinstance(event, RunStarted):\n            self.flush()",
        (f"{TEST_WRITER}::test_the_end_of_a_run_is_committed_when_it_is_reported",),
    ),
    Mutant(
        "a failed disk is not told", WRITER,
        "            self._fail()\n            if self._closing:", "            if self._closing:",
        (f"{TEST_WRITER}::test_after_a_failed_commit_nothing_more_is_taken",),
    ),
    Mutant(
        "a run is overwritten", WRITER,
        "os.O_CREAT | os.O_EXCL", "os.O_CREAT | os.O_TRUNC",
        (f"{TEST_WRITER}::test_a_run_is_never_overwritten",),
    ),
    Mutant(
        "a run goes on with other channels", WRITER,
        "if self._channels is not None and dict(event.channels) != dict(self._channels):",
        "if self._channels is not None and not event.channels:",
        (f"{TEST_WRITER}::test_a_run_goes_on_only_as_it_began",),
    ),
    Mutant(
        "a run goes on before its own past", WRITER,
        "event.time_s < self._last_s:", "event.time_s < -1e9:",
        (f"{TEST_WRITER}::test_a_run_goes_on_only_as_it_began",),
    ),
    Mutant(
        "rows are not chained", ROWS,
        "return sha256(chain + digest).digest()", "return sha256(digest).digest()",
        ("tests/probe/storage/test_older_runs.py",),
    ),
    Mutant(
        "the chain is not checked", READER,
        "stored != link(chain, digest):", "stored is None:",
        (f"{TEST_RUN}::test_replaced_and_lost_rows_are_found",),
    ),
    Mutant(
        "a lost row is not noticed", READER,
        "elif number != expected:", "elif number < 0:",
        (f"{TEST_RUN}::test_replaced_and_lost_rows_are_found",),
    ),
    Mutant(
        "checksums are not checked", READER,
        " or digest != row.sha256:", ":",
        (f"{TEST_RUN}::test_flipped_bytes_are_found_or_harmless",
         f"{TEST_RUN}::test_replaced_and_lost_rows_are_found"),
    ),
    Mutant(
        "not-a-number is stored", ROWS,
        "allow_nan=False", "allow_nan=True",
        (f"{TEST_WRITER}::test_a_number_that_is_none_is_not_stored",),
    ),
    Mutant(
        "foreign tables are read", SCHEMA,
        "if application != APPLICATION_ID:", "if application < 0:",
        (f"{TEST_RUN}::test_what_is_no_run_is_refused_with_a_reason",),
    ),
    Mutant(
        "samples that come twice are not noticed", AUDIT,
        "if not (first > before and (np.diff(block.time_s) > 0).all()):",
        "if not (first > -math.inf):",
        (f"{TEST_VERIFY}::test_what_is_wrong_is_said",),
    ),
    Mutant(
        "a station without its last samples is complete", AUDIT,
        "press.last_sample_s < event.time_s - TAIL_S:", "press.last_sample_s < -1e9:",
        (f"{TEST_VERIFY}::test_what_is_wrong_is_said",),
    ),
    Mutant(
        "samples of another station are not noticed", AUDIT,
        "if press is None or not press.start_s <= first <= last < press.end_s:",
        "if press is None:",
        (f"{TEST_VERIFY}::test_what_is_wrong_is_said",),
    ),
    Mutant(
        "a station without a hold is complete", AUDIT,
        "if phase not in press.phases]):", "if phase in ()]):",
        (f"{TEST_VERIFY}::test_what_is_wrong_is_said",),
    ),
    Mutant(
        "what came during the last commit of a lost run is not kept", WRITER,
        "for n in range(0, len(came_since), ROWS):", "for n in range(0, 0, ROWS):",
        ("tests/probe/storage/test_lost_files.py::"
         "test_what_came_during_the_last_commit_is_kept_too",),
    ),
    Mutant(
        "a run that is cut short is not noticed", "probe/storage/moved_away.py",
        "short = found.st_size < seen.st_size and", "short = False and",
        ("tests/probe/storage/test_cut_files.py",),
    ),
    Mutant(
        "a log that is cut while it is written on is not noticed", "probe/storage/moved_away.py",
        "return log.read(4) == bytes(4)", "return False",
        ("tests/probe/storage/test_cut_files.py::"
         "test_a_log_that_is_cut_between_a_look_and_what_follows_is_noticed",),
    ),
    Mutant(
        "an emptied log is always lost", "probe/storage/moved_away.py",
        "return frames <= 0 or", "return False and",
        ("tests/probe/storage/test_cut_files.py::test_another_programs_checkpoint_is_no_harm",),
    ),
    Mutant("a depth is a stage's height", "probe/core/cut_stations.py",
           "if self.depth is None:", "if True:",
           ("tests/probe/storage/test_csv_import.py::test_depths_are_those_of_the_file",)),
    Mutant("depths stay behind", "probe/storage/csv_import.py",
           "yield from _beside(DEPTHS,", "_beside(DEPTHS,",
           ("tests/probe/storage/test_interchange.py::test_what_export_wrote_is_imported",)),
)  # fmt: skip
