"""ROS 2 bags in SQLite files (.db3): from a damaged one, every row that SQLite can still reach.

Tables as rosbag2's storage plugin makes them: topics, messages, and since its schema 4 message_definitions. Messages
that were compressed one by one are recognised by Zstandard's magic, which no CDR message begins with.
"""

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from urllib.parse import quote

from cmr.litter import temporary_folder
from cmr.plain_text import plain
from cmr_tools.importing.ros_records import LONGEST_NAME, BagError, BagReader, Message, Topic
from cmr_tools.importing.unpacking import decompress

MAGIC = b"SQLite format 3\0"
ZSTANDARD_MAGIC = b"\x28\xb5\x2f\xfd"

HEAD_BYTES = 100  # sqlite.org/fileformat.html
VERSION_VALID_FOR = 92  # offset of the number that must equal the change counter for the number of pages to be valid
ROWS_STEPPED_SINGLY = 32  # behind a damaged row; after that the steps double
LAST_ROW = 2**63 - 1
MOST_STEPS = 10_000

UNREADABLE = (sqlite3.Error, UnicodeDecodeError)  # the latter where SQLite's own sentence quotes damaged text

Row = tuple[int, int, int, bytes]


class SqliteReader(BagReader):
    """Reads one .db3 file. Raises BagError if it has no readable topics."""

    def __iter__(self) -> Iterator[Message]:
        with self._readable() as address, closing(sqlite3.connect(address, uri=True)) as connection:
            connection.text_factory = lambda text: text.decode("utf-8", "replace")
            topics = self._read_topics(connection)
            chosen = {number: topic for number, topic in topics.items() if topic.name in self._wanted}
            for _, number, received, data in self._rows(connection, sorted(chosen)):
                if not isinstance(received, int) or not isinstance(data, bytes):
                    self.fault("a message that is not intact")
                    continue
                if data.startswith(ZSTANDARD_MAGIC):
                    data = decompress("zstd", data)
                if not self.is_too_large(len(data)):
                    yield Message(chosen[number], received, None, data)

    @contextmanager
    def _readable(self) -> Iterator[str]:
        """Provide the address of a database that SQLite opens: the file itself, or a copy, as SQLite may modify it.

        A killed recorder leaves a journal, whose messages SQLite recovers by writing. It refuses a truncated file,
        unless the number of pages in its header is not valid: then it uses the file's size.
        """
        journal = self.path.with_name(self.path.name + "-wal")
        if not journal.exists() and not self._is_cut_off():
            yield f"file:{quote(str(self.path))}?mode=ro&immutable=1"
            return
        with temporary_folder("cmr-import") as folder:
            copy = folder / "bag.db3"
            shutil.copyfile(self.path, copy)
            if journal.exists():
                shutil.copyfile(journal, copy.with_name("bag.db3-wal"))
            if self._is_cut_off():
                self.fault("it is shorter than it says")
                with copy.open("r+b") as stream:
                    stream.seek(VERSION_VALID_FOR)
                    stream.write(b"\xff\xff\xff\xff")
            yield f"file:{quote(str(copy))}"

    def _is_cut_off(self) -> bool:
        with self.path.open("rb") as stream:
            head = stream.read(HEAD_BYTES)
        if len(head) < HEAD_BYTES:
            return False
        page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
        return self.size < (page if page > 1 else 65536) * pages

    def _read_topics(self, connection: sqlite3.Connection) -> dict[int, Topic]:
        try:
            rows = connection.execute("SELECT id, name, type, serialization_format FROM topics").fetchall()
        except UNREADABLE as error:
            raise BagError(
                f"{self.path}: holds no topics of a ROS 2 bag that can be read ({plain(str(error), LONGEST_NAME)})"
            ) from error
        definitions = self._read_definitions(connection)
        topics = {}
        for number, name, kind, encoding in rows:
            language, definition = definitions.get(str(kind), ("", ""))
            topics[number] = self.announce(Topic(str(name), str(kind), str(encoding), definition, language))
        return topics

    def _read_definitions(self, connection: sqlite3.Connection) -> dict[str, tuple[str, str]]:
        """Return language and text of the definitions by type; bags before ROS 2 Iron hold none."""
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        try:
            rows = connection.execute(query).fetchall()
        except UNREADABLE:
            return {}
        return {str(kind): (str(encoding).removeprefix("ros2"), str(text)) for kind, encoding, text in rows if text}

    def _rows(self, connection: sqlite3.Connection, numbers: list[int]) -> Iterator[Row]:
        """Yield the messages of the topics; if a row cannot be read, continue some rows after it."""
        marks = ",".join("?" * len(numbers))
        query = f"SELECT id, topic_id, timestamp, data FROM messages WHERE id > ? AND topic_id IN ({marks}) ORDER BY id"
        last, steps_without_row = 0, 0
        for _ in range(MOST_STEPS):
            try:
                for row in connection.execute(query, (last, *numbers)):
                    if row[0] > last:  # a damaged tree may lead back to rows that were read already
                        last, steps_without_row = row[0], 0
                        yield row
                return
            except UNREADABLE as error:
                if steps_without_row == 0:
                    self.fault(f"rows that cannot be read ({plain(str(error), LONGEST_NAME)})")
            steps_without_row += 1
            last += 1 << max(steps_without_row - ROWS_STEPPED_SINGLY, 0)
            if last >= LAST_ROW:
                return
