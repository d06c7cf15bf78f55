"""The FEBio file of a press, read by nothing of ours: mesh, energy, loads, support and finger."""

from xml.etree import ElementTree

import numpy as np
import pytest

from sim_backend.fem.io.feb import write_feb
from sim_backend.fem.io.slab import exported_section
from sim_backend.fem.material import energy_density
from sim_backend.scene.scene_file import SceneError, Support, load_scene

PRESSURES_MMHG = (80.0, 120.0)
PA_PER_MMHG = 133.322387415


def read(scene, path, x_mm=30.0):
    write_feb(scene, x_mm, 2.0, PRESSURES_MMHG, path)
    return ElementTree.parse(path).getroot()


def numbers(text):
    return [float(v) for v in text.split(",")]


def nodes_mm(root):
    found = {int(n.get("id")): numbers(n.text) for n in root.iterfind("Mesh/Nodes/node")}
    assert sorted(found) == list(range(1, 1 + len(found)))
    return np.array([found[n] for n in sorted(found)])


def elements(root, name):
    block = root.find(f"Mesh/Elements[@name='{name}']")
    return block.get("type"), np.array([numbers(e.text) for e in block], dtype=int) - 1


def faces(root, name):
    surface = root.find(f"Mesh/Surface[@name='{name}']")
    return np.array([numbers(f.text) for f in surface], dtype=int) - 1


def node_set(root, name):
    found = root.find(f"Mesh/NodeSet[@name='{name}']")
    return set() if found is None else {int(v) - 1 for v in numbers(found.text)}


def normals(places, quads):
    a, b, c, d = (places[quads[:, k]] for k in range(4))
    return np.cross(c - a, d - b) / 2


def scene_of(name, **changes):
    return load_scene(name).model_copy(update=changes)


@pytest.fixture(scope="module")
def tisa(tmp_path_factory):
    scene = load_scene("TISA")
    root = read(scene, tmp_path_factory.mktemp("feb") / "tisa.feb")
    return scene, exported_section(scene, 30.0, 2.0, None), root


def test_the_mesh_is_ours_in_two_layers(tisa):
    _, section, root = tisa
    places, plane = nodes_mm(root), 1e3 * section.mesh.nodes
    n = len(plane)
    assert places[:n, :2] == pytest.approx(plane, abs=1e-9)
    assert places[n : 2 * n, :2] == pytest.approx(plane, abs=1e-9)
    assert np.ptp(places[:n, 2]) == np.ptp(places[n : 2 * n, 2]) == 0
    rows = np.vstack([elements(root, f"TISSUE{k}")[1] for k in range(3)])
    assert elements(root, "TISSUE0")[0] == "penta15"
    low = rows[:, [0, 1, 2, 6, 7, 8]]
    assert sorted(map(tuple, low)) == sorted(map(tuple, section.mesh.cells))
    assert (rows[:, [3, 4, 5, 9, 10, 11]] == low + n).all()
    half = (places[rows[:, :3]] + places[rows[:, 3:6]]) / 2
    assert places[rows[:, 12:]] == pytest.approx(half)


def test_each_wedge_has_its_mid_nodes_where_febio_looks_for_them_and_is_not_inside_out(tisa):
    root = tisa[2]
    places = nodes_mm(root)
    _, rows = elements(root, "TISSUE0")
    for mid, (a, b) in {6: (0, 1), 7: (1, 2), 8: (2, 0), 9: (3, 4), 12: (0, 3)}.items():
        straight = (places[rows[:, a]] + places[rows[:, b]]) / 2
        length = np.linalg.norm(places[rows[:, a]] - places[rows[:, b]], axis=1)
        assert (np.linalg.norm(places[rows[:, mid]] - straight, axis=1) < 0.2 * length).all()
    a, b, c, up = (places[rows[:, k]] for k in (0, 1, 2, 3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), up - a) > 0).all()


def test_the_energy_is_ours(tisa):
    """FEBio's U(J) for "Abaqus" is k/2 (J - 1)^2, its isochoric part c1 (I1bar - 3)."""
    _, section, root = tisa
    rng = np.random.default_rng(0)
    f = np.eye(3) + 0.2 * rng.standard_normal((50, 3, 3))
    f[:, 2, :2] = f[:, :2, 2] = 0
    j = np.linalg.det(f)
    i1 = (f * f).sum(axis=(1, 2))
    flat = np.stack([f[:, 0, 0], f[:, 0, 1], f[:, 1, 0], f[:, 1, 1]], axis=1)
    cell_of = {tuple(c): n for n, c in enumerate(section.mesh.cells)}
    for k in range(3):
        one = root.find(f"Material/material[@name='M{k}']")
        assert one.get("type") == "Mooney-Rivlin"
        assert one.findtext("pressure_model") == "Abaqus"
        assert float(one.findtext("c2")) == 0
        c1, bulk = float(one.findtext("c1")), float(one.findtext("k"))
        theirs = c1 * (j ** (-2 / 3) * i1 - 3) + bulk / 2 * (j - 1) ** 2
        for row in elements(root, f"TISSUE{k}")[1][::7]:
            cell = cell_of[tuple(row[[0, 1, 2, 6, 7, 8]])]
            ours = energy_density(flat, f[:, 2, 2], section.shear[cell], section.bulk[cell])
            assert 1e6 * theirs == pytest.approx(ours, rel=1e-9)


def test_the_pressure_acts_outwards_on_the_whole_lumen_and_follows_its_curve(tisa):
    scene, _, root = tisa
    load = root.find("Loads/surface_load")
    assert load.get("type") == "pressure"
    assert load.findtext("linear") == "0"
    quads = faces(root, load.get("surface"))
    places = nodes_mm(root)
    artery = scene.inclusion[0]
    radius = artery.inner_diameter_mm / 2 * (1 - artery.stenosis.fraction)
    out = normals(places, quads)
    middle = places[quads].mean(axis=1)
    centre = np.array([artery.x_mm, scene.surface_mm - artery.depth_mm, 0])
    inwards = centre - middle
    # a positive pressure pushes against the normal out of the body, which points into the lumen
    assert (np.einsum("ij,ij->i", out, inwards) > 0).all()
    assert np.abs(out.sum(axis=0)).max() < 1e-9
    around = np.linalg.norm(out, axis=1).sum() / np.ptp(places[quads][..., 2])
    assert around == pytest.approx(2 * np.pi * radius, rel=0.01)
    curve = root.find(f"LoadData/load_controller[@id='{load.find('pressure').get('lc')}']")
    points = [numbers(p.text) for p in curve.iter("pt")]
    mpa = float(load.findtext("pressure")) * np.array(points)[:, 1]
    assert 1e6 * mpa == pytest.approx([0, *(PA_PER_MMHG * p for p in PRESSURES_MMHG)], rel=1e-6)
    assert [time for time, _ in points] == [0, 1, 2]


def test_the_support_is_ours(tisa):
    _, section, root = tisa
    n = len(section.mesh.nodes)
    low_y = {d // 2 for d in section.fixed if d % 2}
    assert {v for v in node_set(root, "held_y") if v < n} == low_y
    places = nodes_mm(root)
    held_y = places[sorted(node_set(root, "held_y"))]
    assert (held_y[:, 1] == 0).all()
    assert set(held_y[:, 2]) == set(places[places[:, 0] == 0][:, 2])
    assert node_set(root, "held_x") == set()
    assert node_set(root, "held_z") == set(range(n))  # plane stress: the other face is free
    for bc in root.iterfind("Boundary/bc[@node_set]"):
        dofs = {axis for axis in "xyz" if bc.findtext(f"{axis}_dof") == "1"}
        assert dofs == {bc.get("node_set")[-1]}
    (fixed,) = root.findall("Boundary/bc[@type='linear constraint']")
    weight = {int(fixed.findtext("node")) - 1: -1.0}
    for child in fixed.iterfind("child_dof"):
        assert child.findtext("dof") == "x"
        weight[int(child.findtext("node")) - 1] = float(child.findtext("value"))
    total = sum(weight.values())
    ours = dict(zip(section.sliding.dofs[0] // 2, section.sliding.weight, strict=True))
    assert {k: v / total for k, v in weight.items()} == pytest.approx(ours)


def test_the_finger_is_ours_and_is_pushed_to_the_depth(tisa):
    _, section, root = tisa
    places = nodes_mm(root)
    quads = faces(root, "FINGER_FACE")
    gap, _, _ = section.finger.gap(1e-3 * places[np.unique(quads)][:, :2])
    assert np.abs(gap).max() < 1e-9
    assert (normals(places, quads)[:, 1] < 1e-9).all()
    skin = faces(root, "UNDER_FINGER")
    assert (places[skin][..., 1] == 16.83).all()
    assert (normals(places, skin)[:, 1] > 0).all()
    assert set(skin[:, [0, 1, 4]].ravel()) == set(section.mesh.surface)
    pushed = root.find("Rigid/rigid_bc[@type='rigid_displacement']")
    assert pushed.findtext("dof") == "y"
    assert float(pushed.findtext("value")) == -2.0
    fixed = root.find("Rigid/rigid_bc[@name='FINGER_fixed']")
    assert [fixed.findtext(f"R{d}_dof") for d in "xyzuvw"] == ["1", "0", "1", "1", "1", "1"]
    contact = root.find("Contact/contact")
    assert contact.findtext("auto_penalty") == "0"
    assert float(contact.findtext("penalty")) == pytest.approx(500 * 0.05)


def test_plane_strain_holds_both_faces_and_a_lone_vessel_lies_on_its_support(tmp_path):
    loose = scene_of("HAOT", plane="strain", support=Support(contact="frictionless"))
    root = read(loose, tmp_path / "haot.feb", x_mm=32.0)
    _, rows = elements(root, "TISSUE0")
    assert node_set(root, "held_z") == set(rows.ravel())
    places = nodes_mm(root)
    ground = faces(root, "SUPPORT_FACE")
    assert (places[ground][..., 1] == 0).all()
    assert (normals(places, ground)[:, 1] > 0).all()
    assert root.findtext("Rigid/rigid_bc[@name='SUPPORT_fixed']/Ry_dof") == "1"


def test_a_bonded_block_holds_its_bottom_once(tmp_path):
    root = read(scene_of("TI", support=Support(contact="bonded")), tmp_path / "ti.feb")
    assert node_set(root, "held_x") == node_set(root, "held_y") != set()
    assert root.findall("Boundary/bc[@type='linear constraint']") == []


def test_what_it_cannot_say_is_refused(tmp_path):
    with pytest.raises(SceneError, match=r"support\.contact = \"bonded\""):
        read(load_scene("HAOT"), tmp_path / "haot.feb", x_mm=32.0)
