"""The release folder, and the licenses of what the zip brings."""

import hashlib
import subprocess
import zipfile

import pytest

from devtools import licenses, places, release, wheels
from devtools.docs_reference import licenses as license_table


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A release with one small zip in place of those of the platforms."""

    def make_zips(output):
        (output / "one.zip").write_bytes(b"zip")
        return {"linux-x64": output / "one.zip"}

    monkeypatch.setattr(release, "changelog", lambda: "# changes\n")
    return release.release(tmp_path / "out", make_zips)


def test_a_release_has_zips_checksums_changes_and_the_listing(folder, capsys):
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert names == {"one.zip", "SHA256SUMS", "CHANGELOG.md", "listing/listing.md"} | {
        f"listing/{name}" for name in release.PICTURES
    }
    assert (folder / "SHA256SUMS").read_text() == f"{hashlib.sha256(b'zip').hexdigest()}  one.zip\n"


def test_sizes_are_stated(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(release, "changelog", lambda: "x" * 5000)
    release.release(tmp_path / "out", lambda output: {})
    assert "CHANGELOG.md: 0.005 MB" in capsys.readouterr().out


def test_changes_are_the_section_of_this_version(tmp_path, monkeypatch):
    page = tmp_path / "CHANGELOG.md"
    page.write_text(
        "# Changelog\n\n## Unreleased\n\n- new\n\n## 9.9 - 2026-11-28\n\n- second\n\n### Added\n- first\n\n"
        "## 9.8 - 2026-11-27\n\n- old\n"
    )
    monkeypatch.setattr(release, "CHANGELOG", page)
    for version, text in (("9.9", "\n- second\n\n### Added\n- first\n"), ("9.8", "\n- old\n")):
        monkeypatch.setattr(release, "version", lambda: version)  # noqa: B023
        assert release.changelog() == f"# RLE Splat {version}\n{text}"
    monkeypatch.setattr(release, "version", lambda: "9.7")
    with pytest.raises(places.Failure, match=r"no section for version 9\.7"):
        release.changelog()


def test_the_changelog_has_a_section_for_this_version():
    assert release.changelog().count("\n- ") > 2


@pytest.mark.skipif(not (places.ROOT / ".git").exists(), reason="this is no clone")
def test_a_clone_has_the_same_bytes_on_every_system():
    """The hash of the sources is part of the names of compiled kernels."""
    words = ["git", "check-attr", "eol", "--", "rle_splat/scene/scene.py", "docs/index.md"]
    listed = subprocess.run(words, cwd=places.ROOT, capture_output=True, text=True, check=True).stdout
    assert [line.rpartition(" ")[2] for line in listed.splitlines()] == ["lf", "lf"]


def test_the_listing_is_what_the_manifest_says():
    text = release.LISTING.read_text(encoding="utf-8")
    assert "not for diagnosis" in text and "GPL-3.0-or-later" in text
    manifest = (places.ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    name, tagline = (text.split("\n")[line].strip("#* ") for line in (0, 2))
    assert f'name = "{name}"' in manifest and f'tagline = "{tagline}"' in manifest


def test_every_package_of_the_zip_has_a_license():
    known = {one["name"].replace("-", "_") for one in licenses.bundled()}
    assert known == {*wheels.packages(), "Liberation Sans (letters of figures)"}
    shared = (*licenses.ELSEWHERE, "connected-components-3d")
    assert {one["license"] for one in licenses.bundled() if one["name"] in shared} == {"LGPL-3.0-or-later"}
    assert all(f"[{one['name']}]({one['page']}) | {one['license']} |" in license_table() for one in licenses.bundled())


def test_the_texts_of_licenses_come_from_the_wheels(tmp_path):
    paths = [tmp_path / f"one-1.0-{python}-none-any.whl" for python in ("cp311", "cp313")]
    for path in paths:
        with zipfile.ZipFile(path, "w") as wheel:
            wheel.writestr("one/licenses/table.py", "no license")
            wheel.writestr("one-1.0.dist-info/LICENSE", "first")
            wheel.writestr("one-1.0.dist-info/licenses/LICENSE.third-party", "second")
    assert licenses.license_texts(paths) == {
        "licenses/one-LICENSE": b"first", "licenses/one-LICENSE.third-party": b"second"}  # fmt: skip
    with zipfile.ZipFile(tmp_path / "two-1.0-py3-none-any.whl", "w") as wheel:
        wheel.writestr("two-1.0.dist-info/METADATA", "")
    with pytest.raises(places.Failure, match="no text of its license"):
        licenses.license_texts([tmp_path / "two-1.0-py3-none-any.whl"])


def test_the_sentence_on_diagnosis_is_on_the_site_and_in_the_panel():
    sentence = "It is not a medical device and not for diagnosis"
    names = "README.md", "docs/index.md", "docs/reference/licenses.md", "panels/about.py", "devtools/listing.md"
    for name in names:
        assert sentence in (places.ROOT / name).read_text(encoding="utf-8"), name
