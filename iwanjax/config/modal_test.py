"""``model.test``: the linear model of a study by a modal test of its own recordings."""

from collections.abc import Sequence

from iwanjax.config.entries import history_entry
from iwanjax.config.reading import part_of, recordings_of
from iwanjax.config.recordings import RecordingSection
from iwanjax.config.schema import ModalTestSection
from iwanjax.config.source import Place, Source
from iwanjax.modal_analysis import ModalTest, modal_test
from iwanjax.signals import Recording

_PLACE: Place = ("model", "test")


def tested(
    source: Source, section: ModalTestSection, recordings: Sequence[RecordingSection]
) -> ModalTest:
    """The modal test that ``model.test`` asks for.

    Parameters
    ----------
    source : Source
        The study.
    section : ModalTestSection
    recordings : sequence of RecordingSection
        The study's: an entry that only names the file, or the name, of one of these is read as
        it is.

    Raises
    ------
    InputError
        With the place in the study.
    """
    found: list[Recording] = []
    for i, given in enumerate(section.recordings):
        alike = [each for each in recordings if given.file in (each.file, each.name)]
        short = given.model_fields_set == {"file"}
        each = alike[0] if short and alike else given
        entry = history_entry(source, (*_PLACE, "recordings", i), each)
        found += [part_of(entry, recording) for _, recording in recordings_of(entry)]
    options = section.model_dump(exclude={"recordings", "band"}, exclude_none=True)
    with source.blamed(*_PLACE):
        return modal_test(found, section.band, **options)
