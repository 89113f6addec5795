"""One hit, two accelerations and a force, in every format that laboratories bring along."""

import json

import h5py
import numpy as np
import scipy.io
from matlab73 import write_matlab73

N, RATE = 256, 1024.0
TIME = np.arange(N) / RATE
TIP, ROOT = (
    np.exp(-8.0 * TIME) * np.sin(2 * np.pi * f * TIME + 0.1) + 1e-3 * np.cos(9.0 * TIME)
    for f in (80.0, 122.0)
)
HIT = 10.0 * np.exp(-0.5 * ((np.arange(N) - 20.0) / 3.0) ** 2)
# Name, unit, values, quantity.
CHANNELS = [
    ("tip", "m/s^2", TIP, "acceleration"),
    ("root", "m/s^2", ROOT, "acceleration"),
    ("hammer", "N", HIT, "force"),
]
COLUMNS = {"time": TIME, "acc_tip": TIP, "acc_root": ROOT, "force": HIT}


def universal(path):
    import pyuff

    kinds = {"acceleration": 12, "force": 13}
    sets = [
        pyuff.prepare_58(
            binary=0,
            id1="hit",
            id2="NONE",
            id3="25-Nov-26 12:00:00",
            id4="NONE",
            id5="NONE",
            func_type=1,
            ver_num=0,
            load_case_id=0,
            rsp_ent_name=name,
            rsp_node=node,
            rsp_dir=-3,
            ref_ent_name="NONE",
            ref_node=0,
            ref_dir=0,
            ord_data_type=4,
            num_pts=N,
            abscissa_spacing=1,
            abscissa_min=0.0,
            abscissa_inc=1.0 / RATE,
            z_axis_value=0.0,
            abscissa_spec_data_type=17,
            abscissa_len_unit_exp=0,
            abscissa_force_unit_exp=0,
            abscissa_temp_unit_exp=0,
            abscissa_axis_units_lab="s",
            ordinate_spec_data_type=kinds[quantity],
            ordinate_len_unit_exp=0,
            ordinate_force_unit_exp=0,
            ordinate_temp_unit_exp=0,
            ordinate_axis_units_lab=unit,
            orddenom_spec_data_type=0,
            orddenom_len_unit_exp=0,
            orddenom_force_unit_exp=0,
            orddenom_temp_unit_exp=0,
            orddenom_axis_units_lab="NONE",
            z_axis_spec_data_type=0,
            z_axis_len_unit_exp=0,
            z_axis_force_unit_exp=0,
            z_axis_temp_unit_exp=0,
            z_axis_axis_units_lab="NONE",
            data=values,
            x=TIME,
            return_full_dict=True,
        )
        for node, (name, unit, values, quantity) in enumerate(CHANNELS, start=1)
    ]
    path.unlink(missing_ok=True)
    pyuff.UFF(str(path)).write_sets(sets, "add")


def universal_binary(path):
    """Set 58b: the header as text, its second line longer, the values as they are in memory."""
    universal(path)
    parts = []
    for text, (*_, values, _) in zip(
        path.read_text().split("    -1\n")[1::2], CHANNELS, strict=True
    ):
        head = text.splitlines()[1:12]
        kind = f"{58:6d}b{1:6d}{2:6d}{11:12d}{8 * N:12d}{0:6d}{0:6d}{0:12d}{0:12d}"
        lines = "".join(f"{line}\r\n" for line in ("    -1", kind, *head))
        parts.append(lines.encode() + values.astype("<f8").tobytes() + b"    -1\r\n")
    path.write_bytes(b"".join(parts))


def lvm(path, *, comma=False, x_columns="One"):
    """As LabVIEW's Express VI writes it: a header of the file, one of the segment, rows."""
    rows = np.column_stack([TIME, *(values for _, _, values, _ in CHANNELS)])
    lines = [
        "LabVIEW Measurement\t",
        "Writer_Version\t2",
        "Separator\tTab",
        f"Decimal_Separator\t{',' if comma else '.'}",
        f"X_Columns\t{x_columns}",
        "Operator\tN. N.",
        "***End_of_Header***\t",
        "\t",
        "Channels\t3\t\t\t\t",
        "Samples\t" + "\t".join(3 * [str(N)]) + "\t",
        "Y_Unit_Label\t" + "\t".join(unit for _, unit, _, _ in CHANNELS) + "\t",
        "X_Dimension\t" + "\t".join(3 * ["Time"]) + "\t",
        "X0\t" + "\t".join(3 * ["0.0E+0"]) + "\t",
        "Delta_X\t" + "\t".join(3 * [f"{1 / RATE:.10f}"]) + "\t",
        "***End_of_Header***\t\t\t\t",
        "X_Value\t" + "\t".join(name for name, *_ in CHANNELS) + "\tComment",
    ]
    first = "{:.6f}" if x_columns == "One" else ""
    for time, *values in rows:
        lines.append("\t".join([first.format(time), *(f"{x:.9e}" for x in values)]))
    text = "\n".join(lines) + "\n"
    path.write_text(text.replace(".", ",") if comma else text)


def tdms(path):
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    with TdmsWriter(str(path)) as file:
        about = {"wf_increment": 1.0 / RATE, "wf_start_offset": 0.0, "wf_samples": N}
        file.write_segment(
            [
                RootObject({"operator": "N. N."}),
                GroupObject("hit"),
                *(
                    ChannelObject("hit", name, values, {**about, "unit_string": unit})
                    for name, unit, values, _ in CHANNELS
                ),
            ]
        )


def test_lab(path):
    scipy.io.savemat(
        path,
        {
            f"Signal_{i}": {
                "x_values": {
                    "start_value": 0.0,
                    "increment": 1.0 / RATE,
                    "number_of_values": float(N),
                    "quantity": {"label": "s"},
                },
                "y_values": {"values": values[:, None], "quantity": {"label": unit}},
                "function_record": {"name": name, "type": "Time"},
            }
            for i, (name, unit, values, _) in enumerate(CHANNELS)
        },
    )


def csv(path):
    rows = "".join(",".join(map(repr, row)) + ",\n" for row in _rows())
    path.write_text("time,tip,root,hammer,\ns,m/s^2,m/s^2,N,\n" + rows)


def json_columns(path):
    content = {"tip (m/s^2)": TIP.tolist(), "root (m/s^2)": ROOT.tolist(), "force": HIT.tolist()}
    path.write_text(json.dumps({**content, "dt": 1.0 / RATE, "operator": "N. N."}))


def npy(path):
    np.save(path, np.rec.fromarrays(list(COLUMNS.values()), names=list(COLUMNS)))


def wav(path):
    whole = np.column_stack([TIP, ROOT, HIT / 10.0]) / 2.0
    scipy.io.wavfile.write(path, int(RATE), np.round(whole * 2**31).astype(np.int32))


def npz(path):
    np.savez(path, **COLUMNS)


def mat(path):
    scipy.io.savemat(path, {"hit": COLUMNS})


def mat73(path):
    write_matlab73(path, {"hit": COLUMNS})


def hdf5(path):
    with h5py.File(path, "w") as file:
        for name, values in COLUMNS.items():
            file[name] = values


def _rows():
    return np.column_stack([TIME, *(values for _, _, values, _ in CHANNELS)]).tolist()


SAMPLES = {
    "hit.uff": universal,
    "hit.b.uff": universal_binary,
    "hit.lvm": lvm,
    "hit.tdms": tdms,
    "hit.lab.mat": test_lab,
    "hit.csv": csv,
    "hit.json": json_columns,
    "hit.npy": npy,
    "hit.wav": wav,
    "hit.npz": npz,
    "hit.mat": mat,
    "hit.73.mat": mat73,
    "hit.h5": hdf5,
}
"""Names of files, whose ends say how they are read, and what writes them."""


def sample(folder, name):
    path = folder / name
    SAMPLES[name](path)
    return path
